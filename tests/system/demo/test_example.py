"""The example of the documentation runs against the demo."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.support.demos import RunningDemo

pytestmark = pytest.mark.timeout(400)  # it compiles on a machine that does other things, too
EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "read_a_skin.py"


def test_example_reads_the_demo(demo: RunningDemo) -> None:
    done = subprocess.run(
        [sys.executable, EXAMPLE, demo.data / "access.json"],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "fingertip" in done.stdout
    found = re.search(r"between (\d+) and (\d+) touches", done.stdout)
    assert found is not None
    assert int(found[1]) <= int(found[2])
    shares = [float(text) for text in re.findall(r"([\d.]+)% ", done.stdout)]
    assert 0 <= shares[0] <= shares[1] <= 100
