"""Whatever dies with -9, what a node's flash had taken is stored exactly once."""

from __future__ import annotations

import shutil
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path

import httpx
import psutil
import pytest
from eskin_cloud.store.damage import FrameHeader

from tests.support.demos import RunningDemo
from tests.support.processes import ESKIN, wait_until

pytestmark = pytest.mark.nightly

NODES = ["fingertip", "palm", "forearm"]
SLOWLY = ("--nodes", "3", "--speed", "0.25")
"""What is lost or not is no question of speed, and beside these demos others run."""


def waiting_in_flash(data: Path, node: str) -> int:
    path = data / "nodes" / node / "flash.sqlite"
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as db:
        return int(db.execute("SELECT count(*) FROM message").fetchone()[0])


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data of a demo that has ended; to be copied."""
    data = tmp_path_factory.mktemp("ended") / "data"
    with RunningDemo(data, *SLOWLY) as demo:
        demo.wait_for_more(NODES)
        assert demo.stop() == 0
    return data


@pytest.fixture
def data(ended: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(ended, tmp_path / "data"))


@pytest.mark.timeout(900)
def test_what_is_killed_loses_nothing_and_doubles_nothing(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with RunningDemo(data, *SLOWLY) as demo:
        demo.wait_for_more(NODES)
        for victims in [("gateway", "fingertip"), ("cloud", "palm"), ("broker", "forearm")]:
            dead = {victim: demo.children()[victim] for victim in victims}
            for process in dead.values():
                process.kill()
            wait_until(
                lambda dead=dead: _run_again(demo, dead),  # type: ignore[misc]  # likewise no defaults
                f"{' and '.join(victims)} run again",
            )
            wait_until(lambda: bool(_answers(demo)), "the API answers")
            demo.wait_for_more(NODES)
        children = list(demo.children().values())
        demo.kill()
        _, alive = psutil.wait_procs(children, timeout=100)
        assert alive == []
        demo.start()
        demo.wait_for_more(NODES)
        wait_until(lambda: _ranges_are_whole(demo), "every sequence number is stored")
        wait_until(
            lambda: max(waiting_in_flash(data, node) for node in NODES) < 60,
            "what waited has left the flashes",
        )
        assert demo.stop() == 0
        boots = [boot for node, boot in demo.sequences() if node == "fingertip"]
        assert len(boots) == 3
        done = subprocess.run(
            [ESKIN, "audit", "--data", str(data)],
            capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.timeout(700)
def test_audit_sees_a_store_that_was_tampered_with(data: Path) -> None:
    audit = [ESKIN, "audit", "--data", str(data)]
    assert subprocess.run(audit, capture_output=True, timeout=300, check=False).returncode == 0
    with closing(sqlite3.connect(data / "cloud" / "store.sqlite")) as db:
        db.row_factory = sqlite3.Row
        for row in db.execute("SELECT * FROM frames WHERE node = 'palm' LIMIT 9").fetchall():
            moved = dict(row) | {"samples": row["samples"] + 1}
            said = moved["samples"], FrameHeader.of(moved).checksum(), row["cursor"]
            db.execute("UPDATE frames SET samples = ?, head = ? WHERE cursor = ?", said)
        db.commit()
    done = subprocess.run(audit, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1
    assert "under a wrong label" in done.stdout
    assert "broken promise: palm/touch-area.area" in done.stdout
    assert "vanished" not in done.stdout


@pytest.mark.timeout(700)
def test_audit_sees_frames_that_vanished_and_messages_that_were_refused(data: Path) -> None:
    with closing(sqlite3.connect(data / "gateway" / "spool.sqlite")) as db:
        db.execute("INSERT INTO dead_letters VALUES (1, 0, 'palm', 'forged', x'00', x'00')")
        db.commit()
    audit = [ESKIN, "audit", "--data", str(data)]
    done = subprocess.run(audit, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout
    assert "refused by the gateway: 1 of palm: forged" in done.stdout
    assert "claimed coverage of a sample: 1 (" in done.stdout
    with closing(sqlite3.connect(data / "cloud" / "store.sqlite")) as db:
        rows = db.execute("SELECT boot, sequence FROM frames WHERE node = 'palm' ORDER BY 1, 2")
        boot, sequence = list(rows)[-1]
        db.execute("DELETE FROM frames WHERE node = 'palm' AND sequence = ?", (sequence,))
        db.commit()
    done = subprocess.run(audit, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1
    vanished = f"vanished: 1 frames of palm, the first at boot {boot}, sequence {sequence}"
    assert vanished in done.stdout


@pytest.mark.timeout(700)
def test_wiped_flash_repeats_no_number_and_loses_nothing_new(data: Path) -> None:
    for file in (data / "nodes" / "fingertip").glob("flash.sqlite*"):
        file.unlink()
    with RunningDemo(data, *SLOWLY) as demo:
        demo.wait_for_more(NODES)
        assert len([node for node, _ in demo.sequences() if node == "fingertip"]) == 2
        wait_until(lambda: _ranges_are_whole(demo), "every sequence number is stored")


def _run_again(demo: RunningDemo, dead: dict[str, psutil.Process]) -> bool:
    children = demo.children()
    return all(children.get(victim, process) != process for victim, process in dead.items())


def _answers(demo: RunningDemo) -> bool:
    try:
        return bool(demo.get("/nodes")["items"])
    except httpx.HTTPError:
        return False


def _ranges_are_whole(demo: RunningDemo) -> bool:
    """Each boot's sequence numbers are one range from 0: no message of the flash is missing."""
    return all(len(ranges) == 1 and ranges[0][0] == 0 for ranges in demo.sequences().values())
