"""What the emulator knows and the node does not: the true samples behind every block.

A file of its own, written before the flash's commit, so that every stored block has its truth.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import FlashError, LockedError
from eskin.lockfile import LockFile
from eskin.messages import Position

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from eskin.interval import Floats

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS node (key TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;
CREATE TABLE IF NOT EXISTS truth (
    boot INTEGER NOT NULL,
    sequence INTEGER NOT NULL,
    channel TEXT NOT NULL,
    time INTEGER NOT NULL,   -- true UTC of the first sample, ns since 1970
    dt INTEGER NOT NULL,     -- sampling period in ns
    samples BLOB NOT NULL,   -- float64, little endian
    PRIMARY KEY (boot, sequence)
) STRICT, WITHOUT ROWID;
"""
_SLACK: Final = 64
_LATEST: Final = 256
"""Blocks that are looked through for the latest sample: they come in the order of their ends."""


@dataclass(frozen=True, slots=True)
class TrueBlock:
    """The truth behind one block.

    Attributes:
        position: The block's boot and sequence.
        channel: ``{taxel}.{quantity}``.
        time: True UTC of the first sample, ns.
        dt: Sampling period, ns.
        values: True values in the channel's unit, without noise.
    """

    position: Position
    channel: str
    time: int
    dt: int
    values: Floats


class Truth:
    """The emulator's own record. One process writes, others may read meanwhile.

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
            self._db = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = FULL")
            self._db.executescript(_SCHEMA)
            self._used = int(
                self._db.execute(
                    f"SELECT coalesce(sum(length(samples) + {_SLACK}), 0) FROM truth"  # noqa: S608 - a constant
                ).fetchone()[0]
            )
        except LockedError as error:
            raise FlashError(f"{path}: another node keeps its truth here; stop it first") from error
        except (OSError, sqlite3.Error) as error:
            raise FlashError(f"{path}: the truth cannot be opened: {error}") from error

    @classmethod
    def read(cls, path: Path, positions: Sequence[Position]) -> dict[Position, TrueBlock]:
        """Read the truth behind some blocks, also while a node writes.

        Returns:
            What is (still) there.

        Raises:
            FlashError: The file cannot be read.
        """
        found: dict[Position, TrueBlock] = {}
        query = "SELECT channel, time, dt, samples FROM truth WHERE boot = ? AND sequence = ?"
        try:
            with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as db:
                for position in positions:
                    row = db.execute(query, (position.boot, position.sequence)).fetchone()
                    if row is not None:
                        values = np.frombuffer(row[3], dtype="<f8").astype(np.float64)
                        found[position] = TrueBlock(position, row[0], row[1], row[2], values)
        except sqlite3.Error as error:
            raise FlashError(f"{path}: the truth cannot be read: {error}") from error
        return found

    @classmethod
    def positions(cls, path: Path) -> list[Position]:
        """Positions of all blocks whose truth is there, in order.

        Raises:
            FlashError: The file cannot be read.
        """
        query = "SELECT boot, sequence FROM truth ORDER BY boot, sequence"
        try:
            with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as db:
                return [Position(*row) for row in db.execute(query)]
        except sqlite3.Error as error:
            raise FlashError(f"{path}: the truth cannot be read: {error}") from error

    @classmethod
    def oldest(cls, path: Path) -> Position | None:
        """The position of the oldest block whose truth is still there; ``None`` if there is none.

        Raises:
            FlashError: The file cannot be read.
        """
        query = "SELECT boot, sequence FROM truth ORDER BY boot, sequence LIMIT 1"
        try:
            with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as db:
                row = db.execute(query).fetchone()
        except sqlite3.Error as error:
            raise FlashError(f"{path}: the truth cannot be read: {error}") from error
        return None if row is None else Position(*row)

    def end(self) -> int | None:
        """True UTC in ns after the latest sample, over all boots; ``None`` if there is none."""
        row = self._db.execute(
            "SELECT max(time + dt * (length(samples) / 8)) FROM "
            "(SELECT time, dt, samples FROM truth ORDER BY boot DESC, sequence DESC LIMIT ?)",
            (_LATEST,),
        ).fetchone()
        return None if row[0] is None else int(row[0])

    def seed(self, wanted: int | None) -> int:
        """The node's seed: the wanted one, else the recorded one, else a fresh one; recorded."""
        row = self._db.execute("SELECT value FROM node WHERE key = 'seed'").fetchone()
        seed = wanted
        if seed is None:
            seed = int(row[0]) if row else int(np.random.SeedSequence().generate_state(1)[0])
        self._db.execute("INSERT OR REPLACE INTO node VALUES ('seed', ?)", (str(seed),))
        return seed

    def supply(self) -> tuple[int, float] | None:
        """True UTC in ns, and J that a supply held then; ``None`` if none was kept."""
        row = self._db.execute("SELECT value FROM node WHERE key = 'supply'").fetchone()
        if row is None:
            return None
        time, energy = row[0].split()
        return int(time), float(energy)

    def keep_supply(self, time: int, energy: float) -> None:
        """Keep how much a supply holds at a moment.

        Raises:
            FlashError: It cannot be written.
        """
        try:
            self._db.execute(
                "INSERT OR REPLACE INTO node VALUES ('supply', ?)", (f"{time} {energy!r}",)
            )
        except sqlite3.Error as error:
            raise FlashError(f"{self._path}: the truth cannot be written: {error}") from error

    def store(self, blocks: Sequence[TrueBlock]) -> None:
        """Keep the truth behind some blocks, in one commit.

        Raises:
            FlashError: It cannot be written.
        """
        rows = [
            (
                block.position.boot,
                block.position.sequence,
                block.channel,
                block.time,
                block.dt,
                block.values.astype("<f8").tobytes(),
            )
            for block in blocks
        ]
        used = self._used + sum(len(row[5]) + _SLACK for row in rows)
        try:
            self._db.execute("BEGIN IMMEDIATE")
            try:
                self._db.executemany("INSERT OR REPLACE INTO truth VALUES (?,?,?,?,?,?)", rows)
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
                "SELECT boot, sequence, length(samples) FROM truth ORDER BY boot, sequence LIMIT 64"
            ).fetchall()
            if not rows:
                break
            self._db.executemany(
                "DELETE FROM truth WHERE boot = ? AND sequence = ?", [row[:2] for row in rows]
            )
            freed += sum(row[2] + _SLACK for row in rows)
        return freed
