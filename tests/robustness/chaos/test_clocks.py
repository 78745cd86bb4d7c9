"""The clock that is moved is the process's real-time clock, and no other."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

from tests.robustness.chaos.clocks import Wallclock, build_library

if TYPE_CHECKING:
    from pathlib import Path

SLEW_S = 1.0
"""By so much another process may set the machine's own clock meanwhile."""
_CHILD = """
import sys, time
from datetime import UTC, datetime
for _ in range(3):
    before = time.monotonic()
    print(before, time.time(), datetime.now(UTC).timestamp(), time.monotonic(), flush=True)
    sys.stdin.readline()
time.sleep(0.01)
"""


def test_clock_jumps_both_ways(tmp_path: Path) -> None:
    clock = Wallclock(tmp_path / "clock", build_library(tmp_path))
    environment = os.environ | clock.environment
    stated = []
    with subprocess.Popen(
        [sys.executable, "-c", _CHILD],
        env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as child:  # fmt: skip
        assert child.stdin is not None
        assert child.stdout is not None
        for seconds in (3600, -7200, 0):
            stated.append([float(word) for word in child.stdout.readline().split()])
            clock.set(seconds)
            child.stdin.write("\n")
            child.stdin.flush()
    assert child.returncode == 0
    start, ahead, behind = stated
    assert start[0] <= start[3] <= ahead[0] <= ahead[3] <= behind[0] <= behind[3]
    for now, seconds in ((ahead, 3600), (behind, -7200)):
        for wall in (1, 2):
            passed = now[wall] - start[wall] - seconds
            assert now[0] - start[3] - SLEW_S < passed < now[3] - start[0] + SLEW_S
