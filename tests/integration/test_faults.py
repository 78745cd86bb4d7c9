"""Whatever dies with -9, what a node's flash had taken is stored exactly once."""

from __future__ import annotations

import sqlite3
import subprocess
from contextlib import closing
from typing import TYPE_CHECKING

import httpx
import psutil
import pytest

from tests.demos import RunningDemo
from tests.processes import ESKIN, wait_until

if TYPE_CHECKING:
    from pathlib import Path

NODES = ["fingertip", "palm", "forearm"]


def waiting_in_flash(data: Path, node: str) -> int:
    path = data / "nodes" / node / "flash.sqlite"
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as db:
        return int(db.execute("SELECT count(*) FROM message").fetchone()[0])


@pytest.mark.timeout(300)
def test_killed_processes_lose_nothing_and_double_nothing(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with RunningDemo(data) as demo:
        demo.wait_for_more(NODES)
        for victim in ["gateway", "fingertip", "cloud", "broker", "palm", "forearm"]:
            dead = demo.children()[victim]
            dead.kill()
            wait_until(
                lambda victim=victim, dead=dead: demo.children().get(victim, dead) != dead,  # type: ignore[misc]  # likewise no defaults
                f"{victim} runs again",
                seconds=30,
            )
            wait_until(lambda: bool(_answers(demo)), "the API answers", seconds=30)
            demo.wait_for_more(NODES, seconds=60)
        assert demo.stop(seconds=60) == 0
        demo.start()
        demo.wait_for_more(NODES)
        wait_until(lambda: _ranges_are_whole(demo), "every sequence number is stored", seconds=60)
        assert demo.stop(seconds=60) == 0
        left = {node: waiting_in_flash(data, node) for node in NODES}
        assert max(left.values()) < 60, left
        boots = [boot for node, boot in demo.sequences() if node == "fingertip"]
        assert len(boots) >= 3
        done = subprocess.run(
            [ESKIN, "audit", "--data", str(data)],
            capture_output=True, text=True, timeout=100, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.timeout(200)
def test_audit_sees_a_store_that_was_tampered_with(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with RunningDemo(data) as demo:
        demo.wait_for_more(NODES)
        assert demo.stop(seconds=60) == 0
    audit = [ESKIN, "audit", "--data", str(data)]
    assert subprocess.run(audit, capture_output=True, timeout=100, check=False).returncode == 0
    with closing(sqlite3.connect(data / "cloud" / "store.sqlite")) as db:
        db.execute("UPDATE blocks SET lo = lo * 1.01 WHERE node = 'palm' AND sequence < 50")
        db.commit()
    done = subprocess.run(audit, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 1
    assert "under a wrong label" in done.stdout
    assert "broken promise: palm/t01.area" in done.stdout
    assert "vanished" not in done.stdout


@pytest.mark.timeout(200)
def test_audit_sees_blocks_that_vanished_and_messages_that_were_refused(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with RunningDemo(data, "--nodes", "2") as demo:
        demo.wait_for_more(NODES[:2])
        assert demo.stop(seconds=60) == 0
    with closing(sqlite3.connect(data / "gateway" / "spool.sqlite")) as db:
        db.execute("INSERT INTO dead_letters VALUES (1, 0, 'palm', 'forged', x'00', x'00')")
        db.commit()
    audit = [ESKIN, "audit", "--data", str(data)]
    done = subprocess.run(audit, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stdout
    assert "refused by the gateway: 1 of palm: forged" in done.stdout
    assert "claimed coverage of a sample: 1 (channels: 6)" in done.stdout
    with closing(sqlite3.connect(data / "cloud" / "store.sqlite")) as db:
        rows = db.execute("SELECT boot, sequence FROM blocks WHERE node = 'palm' ORDER BY 1, 2")
        boot, sequence = list(rows)[2]
        db.execute("DELETE FROM blocks WHERE node = 'palm' AND sequence = ?", (sequence,))
        db.commit()
    done = subprocess.run(audit, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 1
    vanished = f"vanished: 1 blocks of palm, the first at boot {boot}, sequence {sequence}"
    assert vanished in done.stdout


@pytest.mark.timeout(200)
def test_wiped_flash_repeats_no_number_and_loses_nothing_new(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with RunningDemo(data) as demo:
        demo.wait_for_more(NODES)
        assert demo.stop(seconds=60) == 0
        for file in (data / "nodes" / "fingertip").glob("flash.sqlite*"):
            file.unlink()
        demo.start()
        demo.wait_for_more(NODES)
        assert len([node for node, _ in demo.sequences() if node == "fingertip"]) == 2
        wait_until(lambda: _ranges_are_whole(demo), "every sequence number is stored", seconds=60)


@pytest.mark.timeout(200)
def test_killed_demo_leaves_no_process_and_its_data(tmp_path: Path) -> None:
    with RunningDemo(tmp_path / "data") as demo:
        demo.wait_for_more(NODES)
        children = list(demo.children().values())
        demo.kill()
        _, alive = psutil.wait_procs(children, timeout=20)
        assert alive == []
        demo.start()
        demo.wait_for_more(NODES)
        assert len(demo.sequences()) == 2 * len(NODES)
        wait_until(lambda: _ranges_are_whole(demo), "every sequence number is stored", seconds=60)
        assert demo.stop(seconds=60) == 0


def _answers(demo: RunningDemo) -> bool:
    try:
        return bool(demo.get("/nodes")["items"])
    except httpx.HTTPError:
        return False


def _ranges_are_whole(demo: RunningDemo) -> bool:
    """Each boot's sequence numbers are one range from 0: no message of the flash is missing."""
    return all(len(ranges) == 1 and ranges[0][0] == 0 for ranges in demo.sequences().values())
