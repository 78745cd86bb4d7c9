"""Events of processes whose clocks differ by an hour are in order, at equal milliseconds too."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from typing import TYPE_CHECKING

from eskin.wire.messages import Kind
from tests.robustness.chaos.clocks import Wallclock, build_library
from tests.robustness.chaos.recorder import read_events, record_flash, record_spool, record_store
from tests.robustness.model.traces import Event, vanished

if TYPE_CHECKING:
    from pathlib import Path

_FLASH = "CREATE TABLE message (member TEXT, kind INTEGER, boot INTEGER, sequence INTEGER)"
_SPOOL = """CREATE TABLE messages (node TEXT, boot INTEGER, sequence INTEGER);
    CREATE TABLE nodes (node TEXT, held_boot INTEGER, held_sequence INTEGER)"""
_STORE = """CREATE TABLE frames (node TEXT, boot INTEGER, sequence INTEGER);
    CREATE TABLE lost_ranges (node TEXT, boot INTEGER, first INTEGER, last INTEGER)"""
_MAKE_TEN = """
import sqlite3, sys
database = sqlite3.connect(sys.argv[1], isolation_level=None)
for sequence in range(10):
    database.execute("INSERT INTO message VALUES ('palm', ?, 1, ?)", (sys.argv[2], sequence))
"""


def test_times_of_a_moved_clock_are_set_right_to_the_millisecond(tmp_path: Path) -> None:
    flash, spool, store = (tmp_path / name for name in ("flash", "spool", "store"))
    tables = (_FLASH, _SPOOL, _STORE)
    for path, text in zip((flash, spool, store), tables, strict=True):
        with closing(sqlite3.connect(path)) as database:
            database.executescript(text)
    record_flash(flash)
    record_spool(spool)
    record_store(store)
    clock = Wallclock(tmp_path / "clock", build_library(tmp_path))
    before = time.time()
    for seconds in (0, 3600, -3600):
        clock.set(seconds)
        subprocess.run(
            [sys.executable, "-c", _MAKE_TEN, str(flash), str(Kind.FRAME.value)],
            env=os.environ | clock.environment,
            check=True,
        )
    with closing(sqlite3.connect(spool, isolation_level=None)) as database:
        database.execute("INSERT INTO messages VALUES ('palm', 1, 9)")
    found = read_events(
        flashes={"palm": flash}, spools={"gateway": spool}, store=store, now=time.time()
    )
    assert [each.what for each in found] == [*["made"] * 30, "spooled"]
    for each in found:
        assert before - 1.0 < each.time < time.time() + 1.0
        # So that events at one millisecond compare equal, and are sorted by their kinds.
        assert each.time == round(each.time, 3)


def test_frame_that_vanished_from_a_flash_is_named() -> None:
    events = [
        Event(1.0, what, "palm", 7, sequence)
        for what, sequence in (
            *(("made", sequence) for sequence in range(4)),
            *(("freed", sequence) for sequence in (0, 2)),
            ("evicted", 1),
            ("stored", 0),
        )
    ]
    assert vanished(events) == [("palm", 7, 2), ("palm", 7, 3)]
    assert vanished(event._replace(node="hand") for event in events if event.sequence < 2) == []
