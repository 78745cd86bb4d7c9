"""A large skin through the real stack: whatever is killed, its frames are stored exactly once."""

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


def set_node(demo: RunningDemo, **arguments: float | str) -> None:
    """Send a command, and wait until the node has executed it and reports its state."""
    place = f"/api/v1/nodes/{SKIN}"
    with demo.client() as client:
        body = {"name": "set", "arguments": arguments}
        answer = client.post(f"{place}/commands", json=body)
        answer.raise_for_status()
        wait_until(
            lambda: client.get(answer.headers["Location"]).json()["state"] == "done", "it is done"
        )
        state = client.get(f"{place}/state").json()
        assert state["reported"]["*"].items() >= arguments.items()
        assert state["settled"]


def is_whole(demo: RunningDemo) -> bool:
    """Whether each boot's sequence numbers are one range from 0."""
    return all(len(ranges) == 1 and ranges[0][0] == 0 for ranges in demo.sequences().values())


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_skin_obeys_and_its_frames_survive_every_kill_and_enclose_the_truth(tmp_path: Path) -> None:
    data = tmp_path / "data"
    # What is left out because it comes too late would be a gap of its own.
    with RunningDemo(data, "--skin", SKIN, env={"ESKIN_SAMPLING_OVERRUN_S": "600"}) as demo:
        wait_for_frames(data)
        set_node(demo, mode="peaks")
        set_node(demo, mode="samples", rate=100.0)
        wait_for_frames(data)
        (gap,) = demo.get("/events", node=SKIN, kind="gap")["items"]
        assert "deep sleep: ordered" in gap["detail"]
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
