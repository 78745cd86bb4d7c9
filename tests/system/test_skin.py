"""A large skin through the real stack: whatever dies with -9, its frames are stored exactly once."""

from __future__ import annotations

import re
import sqlite3
import subprocess
from contextlib import closing
from typing import TYPE_CHECKING

import psutil
import pytest

from tests.support.demos import RunningDemo
from tests.support.processes import ESKIN, wait_until

if TYPE_CHECKING:
    from pathlib import Path

SKIN = "small-hand"


def stored_frames(data: Path) -> int:
    path = data / "cloud" / "store.sqlite"
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as db:
        return int(db.execute("SELECT count(*) FROM frames").fetchone()[0])


def wait_for_frames(data: Path) -> None:
    """Wait until a second's frames more are stored than now."""
    before = stored_frames(data)
    wait_until(lambda: stored_frames(data) >= before + 10, "more frames are stored")


def is_whole(demo: RunningDemo) -> bool:
    """Whether each boot's sequence numbers are one range from 0."""
    return all(len(ranges) == 1 and ranges[0][0] == 0 for ranges in demo.sequences().values())


@pytest.mark.timeout(600)
def test_frames_of_a_skin_survive_every_kill_and_enclose_the_truth(tmp_path: Path) -> None:
    data = tmp_path / "data"
    # What is left out because it comes too late would be a gap of its own.
    with RunningDemo(data, "--skin", SKIN, env={"ESKIN_SAMPLING_OVERRUN_S": "600"}) as demo:
        wait_for_frames(data)
        for victim in ("gateway", SKIN, "cloud", "broker"):
            dead = demo.children()[victim]
            dead.kill()
            wait_until(lambda dead=dead, victim=victim: _runs_again(demo, victim, dead), victim)  # type: ignore[misc]  # defaults
            wait_for_frames(data)
        children = list(demo.children().values())
        demo.kill()
        _, alive = psutil.wait_procs(children, timeout=100)
        assert alive == []
        demo.start()
        wait_for_frames(data)
        wait_until(lambda: is_whole(demo), "every sequence number is stored")
        assert demo.stop() == 0
        boots = [boot for node, boot in demo.sequences() if node == SKIN]
        assert len(boots) == 3
    done = subprocess.run(
        [ESKIN, "audit", "--data", str(data)],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    samples, violations = re.findall(r"passed: (\d+) samples, (\d+) violations", done.stdout)[0]
    assert int(samples) > 336 * 5 * 50
    assert int(violations) == 0


def _runs_again(demo: RunningDemo, victim: str, dead: psutil.Process) -> bool:
    return demo.children().get(victim, dead) != dead
