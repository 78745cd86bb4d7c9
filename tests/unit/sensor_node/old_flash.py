"""Flashes as nodes and fleets wrote them before they were sealed."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Final

from eskin_sensor_node.firmware.message_writer import BLOCK

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from eskin_sensor_node.firmware.chip import Position

_NODE: Final = """
CREATE TABLE counter (name TEXT PRIMARY KEY, value INTEGER NOT NULL) STRICT;
INSERT INTO counter VALUES ('boot', 5), ('gaps', 2);
CREATE TABLE message (
    boot INTEGER NOT NULL,
    sequence INTEGER NOT NULL,
    weight INTEGER NOT NULL,
    earliest INTEGER NOT NULL,
    latest INTEGER NOT NULL,
    samples INTEGER NOT NULL,
    stands_for INTEGER NOT NULL,
    kind INTEGER NOT NULL,
    body BLOB NOT NULL,
    PRIMARY KEY (boot, sequence)
) STRICT;
CREATE TABLE answer (one INTEGER PRIMARY KEY CHECK (one = 1), body BLOB NOT NULL) STRICT;
CREATE TABLE charge (one INTEGER PRIMARY KEY CHECK (one = 1), body BLOB NOT NULL) STRICT;
CREATE INDEX message_weight ON message (weight, boot, sequence);
"""
_FLEET: Final = """
CREATE TABLE member (
    id INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    boot INTEGER NOT NULL,
    gaps INTEGER NOT NULL DEFAULT 0
) STRICT;
CREATE TABLE message (
    member INTEGER NOT NULL,
    boot INTEGER NOT NULL,
    sequence INTEGER NOT NULL,
    shelf INTEGER NOT NULL,
    earliest INTEGER NOT NULL,
    latest INTEGER NOT NULL,
    samples INTEGER NOT NULL,
    stands_for INTEGER NOT NULL,
    kind INTEGER NOT NULL,
    body BLOB NOT NULL,
    PRIMARY KEY (member, boot, sequence)
) STRICT, WITHOUT ROWID;
CREATE TABLE answer (member INTEGER PRIMARY KEY, body BLOB NOT NULL) STRICT;
"""
TIME: Final = (1_790_000_000_123_456_789, 1_790_000_002_987_654_321)
ANSWER: Final = b"an answer in the clear"
CHARGE: Final = b"a charge in the clear"
SECRETS: Final = (b"in the clear", *(moment.to_bytes(8, "big") for moment in TIME))
"""Of them nothing may be left."""


def write_old_flash(path: Path, bodies: Mapping[Position, bytes]) -> None:
    """A node's: deleted ones leave free pages, as acknowledged messages do."""
    with closing(_written(path, _NODE)) as db:
        rows = [(*place, 0, *TIME, 250, 1, BLOCK, body) for place, body in bodies.items()]
        gone = [(1, n, 0, *TIME, 250, 1, BLOCK, b"gone in the clear" * 40) for n in range(40)]
        db.executemany("INSERT INTO message VALUES (?,?,?,?,?,?,?,?,?)", rows + gone)
        db.execute("DELETE FROM message WHERE boot = 1")
        db.execute("INSERT INTO answer VALUES (1, ?)", (ANSWER,))
        db.execute("INSERT INTO charge VALUES (1, ?)", (CHARGE,))


def write_old_storage(path: Path, names: Sequence[str], bodies: Mapping[str, bytes]) -> None:
    """A fleet's, with one message of boot 5 for each member and an answer."""
    with closing(_written(path, _FLEET)) as db:
        for number, name in enumerate(names, start=3):
            db.execute("INSERT INTO member VALUES (?, ?, 5, 2)", (number, name))
            row = (number, 5, 7, 0, *TIME, 250, 1, BLOCK, bodies[name])
            db.execute("INSERT INTO message VALUES (?,?,?,?,?,?,?,?,?,?)", row)
            db.execute("INSERT INTO answer VALUES (?, ?)", (number, ANSWER))


def _written(path: Path, schema: str) -> sqlite3.Connection:
    db = sqlite3.connect(path, isolation_level=None)
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("PRAGMA secure_delete = OFF")
    db.executescript(schema)
    return db
