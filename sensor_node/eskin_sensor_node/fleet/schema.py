"""The tables of a fleet's flash, and how what lay in the clear before is sealed."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Final

from eskin_sensor_node.machine.flash.key_check import PROOF
from eskin_sensor_node.machine.flash.sealing import Sealing, kept_in_clear

if TYPE_CHECKING:
    import sqlite3

    from eskin_sensor_node.machine.flash.cipher import Cipher

SCHEMA: Final = (
    """CREATE TABLE IF NOT EXISTS member (
        id INTEGER PRIMARY KEY,
        name TEXT NOT NULL UNIQUE,
        boot INTEGER NOT NULL,
        gaps INTEGER NOT NULL DEFAULT 0
    ) STRICT""",
    """CREATE TABLE IF NOT EXISTS message (
        member INTEGER NOT NULL,
        boot INTEGER NOT NULL,
        sequence INTEGER NOT NULL,
        shelf INTEGER NOT NULL,      -- where the outbox put it
        earliest INTEGER NOT NULL,   -- UTC ns, whole minutes
        latest INTEGER NOT NULL,
        samples INTEGER NOT NULL,
        stands_for INTEGER NOT NULL, -- messages: itself, and those that a gap names
        kind INTEGER NOT NULL,
        body BLOB NOT NULL,          -- sealed
        size INTEGER NOT NULL,       -- bytes that the outbox counts
        PRIMARY KEY (member, boot, sequence)
    ) STRICT, WITHOUT ROWID""",
    "CREATE TABLE IF NOT EXISTS answer (member INTEGER PRIMARY KEY, body BLOB NOT NULL) STRICT",
    """CREATE TABLE IF NOT EXISTS unreadable ( -- records that did not open
        member INTEGER PRIMARY KEY,
        records INTEGER NOT NULL
    ) STRICT""",
    """CREATE TABLE IF NOT EXISTS ended ( -- the last number of each boot
        member INTEGER NOT NULL,
        boot INTEGER NOT NULL,
        last INTEGER NOT NULL,
        digest INTEGER NOT NULL,
        PRIMARY KEY (member, boot)
    ) STRICT, WITHOUT ROWID""",
    PROOF,
    # Nothing else ever changes a record's kind.
    """CREATE TRIGGER IF NOT EXISTS gave_up AFTER UPDATE OF kind ON message BEGIN
        INSERT INTO unreadable VALUES (new.member, 1)
        ON CONFLICT (member) DO UPDATE SET records = records + 1;
    END""",
)
SEAL: Final = (
    "ALTER TABLE message ADD COLUMN size INTEGER NOT NULL DEFAULT 0",
    """UPDATE message SET size = length(body), body = (
            SELECT sealed(name, boot, sequence, kind, body, earliest, latest, samples, stands_for)
            FROM member WHERE id = message.member
        ), earliest = minute_before(earliest), latest = minute_behind(latest)""",
    """UPDATE answer SET body = (
        SELECT sealed_last(name, 'answer', body) FROM member WHERE id = answer.member)""",
)
"""How they seal what lay in the clear, where `teach` has told them."""
RECORDS: Final = """SELECT name, message.boot, sequence, kind, body, earliest, latest, samples,
    stands_for FROM message JOIN member ON id = member"""


def teach(db: sqlite3.Connection, cipher: Cipher) -> None:
    """Let statements seal what a member's row holds."""
    db.create_function("sealed", 9, partial(_sealed, cipher))
    db.create_function("sealed_last", 3, partial(_sealed_last, cipher))


def _sealed(cipher: Cipher, name: str, *row: Any) -> bytes:
    return Sealing(cipher, name).seal(kept_in_clear(*row)).body


def _sealed_last(cipher: Cipher, name: str, what: str, body: bytes) -> bytes:
    return Sealing(cipher, name).seal_last(what, body)
