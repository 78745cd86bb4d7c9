"""After `eskin warm` a notebook compiles nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

from eskin.cli.warm import WarmedPart, warm
from eskin.errors import SettingsError
from eskin.kernels import arithmetic
from eskin.kernels.jit import kernel
from tests.support.processes import ESKIN

ROOT = Path(__file__).parents[3]


def run(folder: Path, *command: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, cwd=ROOT, env=os.environ | {"NUMBA_CACHE_DIR": str(folder)},
        capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_notebook_compiles_nothing_after_it(tmp_path: Path) -> None:
    warmed = run(tmp_path, ESKIN, "warm", "notebook")
    assert warmed.returncode == 0, warmed.stderr
    used = run(tmp_path, sys.executable, "-m", "tests.unit.eskin.first_use")
    assert used.returncode == 0, used.stderr
    assert used.stdout.split() == []


def test_it_refuses_where_nothing_can_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: object) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(Dispatcher, "enable_caching", refuse)
    monkeypatch.setattr(arithmetic, "add", kernel(lambda x: x + 1.0))
    with pytest.raises(SettingsError, match="NUMBA_CACHE_DIR"):
        warm([WarmedPart.NOTEBOOK])
