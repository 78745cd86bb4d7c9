"""Records what becomes of frames, by triggers in the files of flash, spool and store.

A trigger's row is durable if and only if the change is.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Final

from eskin.wire.messages import Kind
from tests.robustness.model.traces import Event
from tests.support.files import ask

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

_TABLE: Final = """CREATE TABLE trace (id INTEGER PRIMARY KEY, time INTEGER, what TEXT, node TEXT,
    boot INTEGER, sequence INTEGER)"""
_TRIGGER: Final = """CREATE TRIGGER trace_{what}_{verb} AFTER {verb} ON {table} {when} BEGIN
    INSERT INTO trace (time, what, node, boot, sequence)
    VALUES (round((julianday('now') - 2440587.5) * 86400000), '{what}', {values}); END"""
"""Times are whole milliseconds: as days, those of a moved clock would be some 40 us off."""
_FRAME: Final = f"WHEN {{row}}.kind = {Kind.FRAME.value}"
_POSITION: Final = "{row}.{node}, {row}.boot, {row}.sequence"
_HOUR_MS: Final = 3_600_000


def record_flash(path: Path) -> None:
    """Record what is made and deleted in a flash from now on."""
    _record(path, [
        _trigger("made", "INSERT", "message", "new", "member", _FRAME),
        _trigger("freed", "DELETE", "message", "old", "member", _FRAME),
    ])  # fmt: skip


def record_spool(path: Path) -> None:
    """Record what is spooled and settled from now on, and cut-offs."""
    cut = "new.node, new.held_boot, new.held_sequence"
    _record(path, [
        _trigger("spooled", "INSERT", "messages", "new"),
        _trigger("settled", "DELETE", "messages", "old"),
        _TRIGGER.format(what="cut", verb="INSERT", table="nodes", when="", values=cut),
    ])  # fmt: skip


def record_store(path: Path) -> None:
    """Record which frames are stored from now on."""
    _record(path, [_trigger("stored", "INSERT", "frames", "new")])


def read_events(
    *,
    flashes: Mapping[str, Path],
    spools: Mapping[str, Path],
    store: Path,
    now: float,
) -> list[Event]:
    """What was recorded; each time is within half an hour of ``now``.

    Args:
        flashes: By node.
        spools: By gateway.
        store: The cloud's.
        now: UTC seconds. Clocks that were an hour off are set right by it.
    """
    query = "SELECT time, what, node, boot, sequence FROM trace ORDER BY id"
    lost: dict[str, list[tuple[int, int, int]]] = {node: [] for node in flashes}
    for node, *span in ask(store, "SELECT node, boot, first, last FROM lost_ranges"):
        lost[node].append((span[0], span[1], span[2]))
    found = []
    for node, path in flashes.items():
        for time, what, _, boot, sequence in ask(path, query):
            evicted = what == "freed" and _is_within(lost[node], boot, sequence)
            kind = "evicted" if evicted else what
            found.append(Event(_near(now, time), kind, node, boot, sequence))
    frames = {(each.node, each.boot, each.sequence) for each in found}
    for gateway, path in spools.items():
        for time, what, node, boot, sequence in ask(path, query):
            if what == "cut" or (node, boot, sequence) in frames:
                found.append(Event(_near(now, time), what, node, boot, sequence, gateway))
    found += [Event(_near(now, time), *rest) for time, *rest in ask(store, query)]
    return [each for each in found if each.node in flashes]


def _near(now: float, time: int) -> float:
    """A recorded time, in seconds; equal ones stay equal however far a clock was off."""
    return (time + _HOUR_MS * round((1000.0 * now - time) / _HOUR_MS)) / 1000.0


def _is_within(spans: Iterable[tuple[int, int, int]], boot: int, sequence: int) -> bool:
    return any(b == boot and first <= sequence <= last for b, first, last in spans)


def _trigger(what: str, verb: str, table: str, row: str, node: str = "node", when: str = "") -> str:
    values = _POSITION.format(row=row, node=node)
    when = when.format(row=row)
    return _TRIGGER.format(what=what, verb=verb, table=table, when=when, values=values)


def _record(path: Path, triggers: Iterable[str]) -> None:
    with closing(sqlite3.connect(path, timeout=60, isolation_level=None)) as database:
        database.execute("BEGIN IMMEDIATE")
        for statement in (_TABLE, *triggers):
            database.execute(statement)
        database.execute("COMMIT")
