"""A short soak of the real stack: what was acknowledged is stored, each process is judged."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import psutil
import pytest

from benchmarks.soak import soak
from tests.support.processes import Running, wait_until

pytestmark = pytest.mark.nightly


@pytest.mark.timeout(900)
def test_soak_misses_nothing_and_judges_all(tmp_path: Path) -> None:
    found = soak(tmp_path, duration=10.0, rate=50.0, rest=0.0)
    assert found["sent"] > 0
    assert found["missing"] == 0
    assert found["frames"] > 0
    assert found["wrong"] == []
    assert set(found["processes"]) == {"broker", "gateway", "cloud"}
    for part in found["processes"].values():
        lo, hi = part["growth_an_hour"]
        assert lo <= hi
        assert 0 < part["idle"] <= part["most"]


def test_soak_that_is_signalled_to_end_ends_what_it_started(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.soak", "--rate", "10"]
    with (
        tempfile.TemporaryDirectory() as short,  # the path of a socket has room for 107 bytes
        Running(command, log=tmp_path / "log", env={"TMPDIR": short}) as running,
    ):
        assert running.process is not None
        own = psutil.Process(running.process.pid)
        running.wait_for(lambda: len(own.children()) >= 3, "broker, gateway and cloud run")
        started = own.children()
        assert running.stop() == 143
        assert list(Path(short).iterdir()) == []
    wait_until(lambda: not any(each.is_running() for each in started), "all of them are gone")
