"""The clock that is moved is the process's real-time clock, and no other."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

from tests.chaos.clocks import Wallclock, build_library

if TYPE_CHECKING:
    from pathlib import Path

_CHILD = """
import sys, time
from datetime import UTC, datetime
for _ in range(3):
    print(time.time(), datetime.now(UTC).timestamp(), time.monotonic(), flush=True)
    sys.stdin.readline()
time.sleep(0.01)
"""


def test_clock_jumps_both_ways(tmp_path: Path) -> None:
    clock = Wallclock(tmp_path / "clock", build_library(tmp_path))
    environment = os.environ | clock.environment
    told = []
    with subprocess.Popen(
        [sys.executable, "-c", _CHILD],
        env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as child:  # fmt: skip
        assert child.stdin is not None
        assert child.stdout is not None
        for seconds in (3600, -7200, 0):
            told.append([float(word) for word in child.stdout.readline().split()])
            clock.set(seconds)
            child.stdin.write("\n")
            child.stdin.flush()
    assert child.returncode == 0
    (start, also, steady), ahead, behind = told
    assert 0.0 <= also - start < 60.0
    for now, seconds in ((ahead, 3600), (behind, -7200)):
        passed = now[2] - steady
        assert 0.0 <= passed < 60.0
        assert abs(now[0] - start - seconds - passed) < 1.0
        assert abs(now[1] - start - seconds - passed) < 1.0
