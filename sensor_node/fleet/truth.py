"""What the emulator knows of a fleet: the true samples behind every block of every member."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import FlashError, LockedError
from eskin.lockfile import LockFile
from eskin.messages import Position
from sensor_node.truth import TrueBlock

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS fleet (key TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;
CREATE TABLE IF NOT EXISTS truth (
    id INTEGER PRIMARY KEY,  -- in the order of their making
    member TEXT NOT NULL,
    boot INTEGER NOT NULL,
    sequence INTEGER NOT NULL,
    channel TEXT NOT NULL,
    time INTEGER NOT NULL,   -- true UTC of the first sample, ns since 1970
    dt INTEGER NOT NULL,     -- sampling period in ns
    samples BLOB NOT NULL    -- float64, little endian
) STRICT;
CREATE UNIQUE INDEX IF NOT EXISTS truth_position ON truth (member, boot, sequence);
"""
_SLACK: Final = 128
_FORGOTTEN_AT_ONCE: Final = 1000


class FleetTruth:
    """The record of a whole fleet, in one file.

    Args:
        path: Database file; made if missing.
        limit: Bytes of samples to keep; the oldest give way.

    Raises:
        FlashError: It cannot be opened.
    """

    def __init__(self, path: Path, *, limit: int) -> None:
        self._path = path
        self._limit = limit
        try:
            self._owner = LockFile(path)
            self._db = sqlite3.connect(path, isolation_level=None)
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = FULL")
            self._db.executescript(_SCHEMA)
            self._used = int(
                self._db.execute(
                    f"SELECT coalesce(sum(length(samples) + {_SLACK}), 0) FROM truth"  # noqa: S608 - a constant
                ).fetchone()[0]
            )
        except LockedError as error:
            raise FlashError(
                f"{path}: another fleet keeps its truth here; stop it first"
            ) from error
        except (OSError, sqlite3.Error) as error:
            raise FlashError(f"{path}: the truth cannot be opened: {error}") from error

    @classmethod
    def read(cls, path: Path, member: str) -> dict[Position, TrueBlock]:
        """All that is (still) known of a member's blocks, also while the fleet runs.

        Raises:
            FlashError: The file cannot be read.
        """
        query = "SELECT boot, sequence, channel, time, dt, samples FROM truth WHERE member = ?"
        try:
            with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as db:
                rows = db.execute(query, (member,)).fetchall()
        except sqlite3.Error as error:
            raise FlashError(f"{path}: the truth cannot be read: {error}") from error
        found = (
            TrueBlock(
                Position(row[0], row[1]), row[2], row[3], row[4], np.frombuffer(row[5], "<f8")
            )
            for row in rows
        )
        return {block.position: block for block in found}

    def end(self) -> int | None:
        """True UTC in ns after the latest sample of all; ``None`` if there is none."""
        query = "SELECT max(time + dt * (length(samples) / 8)) FROM truth"
        row = self._db.execute(query).fetchone()
        return None if row[0] is None else int(row[0])

    def seed(self, wanted: int | None) -> int:
        """The fleet's seed: the wanted one, else the recorded one, else a fresh one; recorded."""
        row = self._db.execute("SELECT value FROM fleet WHERE key = 'seed'").fetchone()
        seed = wanted
        if seed is None:
            seed = int(row[0]) if row else int(np.random.SeedSequence().generate_state(1)[0])
        self._db.execute("INSERT OR REPLACE INTO fleet VALUES ('seed', ?)", (str(seed),))
        return seed

    def store(self, blocks: Sequence[tuple[str, TrueBlock]]) -> None:
        """Keep the truth behind some blocks, each with its member's name, in one commit.

        Raises:
            FlashError: It cannot be written.
        """
        rows = [
            (
                name,
                block.position.boot,
                block.position.sequence,
                block.channel,
                block.time,
                block.dt,
                block.values.astype("<f8").tobytes(),
            )
            for name, block in blocks
        ]
        used = self._used + sum(len(row[-1]) + _SLACK for row in rows)
        try:
            self._db.execute("BEGIN IMMEDIATE")
            try:
                self._db.executemany(
                    "INSERT INTO truth (member, boot, sequence, channel, time, dt, samples) "
                    "VALUES (?,?,?,?,?,?,?)",
                    rows,
                )
                used -= self._drop(used - self._limit)
                self._db.execute("COMMIT")
            finally:
                if self._db.in_transaction:
                    self._db.execute("ROLLBACK")
        except sqlite3.Error as error:
            raise FlashError(f"{self._path}: the truth cannot be written: {error}") from error
        self._used = used

    def close(self) -> None:
        """Close the file."""
        self._db.close()
        self._owner.close()

    def _drop(self, excess: int) -> int:
        """Forget the oldest; gives the bytes that this frees."""
        freed = 0
        while freed < excess:
            rows = self._db.execute(
                "DELETE FROM truth WHERE id IN (SELECT id FROM truth ORDER BY id LIMIT ?) "
                "RETURNING length(samples)",
                (_FORGOTTEN_AT_ONCE,),
            ).fetchall()
            if not rows:
                break
            freed += sum(row[0] + _SLACK for row in rows)
        return freed
