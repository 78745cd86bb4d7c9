"""The flash of a fleet: one file, a partition for each node, one synchronised commit for many."""

from __future__ import annotations

import sqlite3
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from eskin.errors import FlashError, LockedError
from eskin.lockfile import LockFile
from sensor_node.firmware.chip import Kept

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from sensor_node.firmware.chip import Position
    from sensor_node.firmware.record import Record

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS member (
    id INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    boot INTEGER NOT NULL,
    gaps INTEGER NOT NULL DEFAULT 0
) STRICT;
CREATE TABLE IF NOT EXISTS message (
    member INTEGER NOT NULL,
    boot INTEGER NOT NULL,
    sequence INTEGER NOT NULL,
    shelf INTEGER NOT NULL,      -- where the outbox put it
    earliest INTEGER NOT NULL,   -- UTC ns
    latest INTEGER NOT NULL,
    samples INTEGER NOT NULL,
    stands_for INTEGER NOT NULL, -- messages: itself, and those that a gap names
    kind INTEGER NOT NULL,
    body BLOB NOT NULL,
    PRIMARY KEY (member, boot, sequence)
) STRICT, WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS answer (member INTEGER PRIMARY KEY, body BLOB NOT NULL) STRICT;
"""
_SELECT: Final = (
    "SELECT boot, sequence, kind, body, earliest, latest, samples, stands_for FROM message "
)


class Storage:
    """The file. Opening counts the boots of all members, durably. For one thread.

    Args:
        path: Database file; made if missing.
        names: The members'.
        epoch: Boot of a fresh member; ``None`` takes the present in seconds.

    Raises:
        FlashError: It cannot be opened; or, by any method here or of a partition, it cannot be read
            or written.
    """

    def __init__(self, path: Path, names: Sequence[str], *, epoch: int | None = None) -> None:
        self._path = path
        first = int(time.time()) if epoch is None else epoch
        try:
            self._owner = LockFile(path)
            self.db = sqlite3.connect(path, isolation_level=None)
            self.db.execute("PRAGMA journal_mode = WAL")
            self.db.execute("PRAGMA synchronous = FULL")
            self.db.executescript(_SCHEMA)
            self.db.execute("BEGIN IMMEDIATE")
            self.db.executemany(
                "INSERT INTO member (name, boot) VALUES (?, ?) "
                "ON CONFLICT (name) DO UPDATE SET boot = boot + 1",
                ((name, first) for name in names),
            )
            self.db.execute("COMMIT")
        except LockedError as error:
            raise FlashError(f"{path}: another fleet runs on this flash; stop it first") from error
        except (OSError, sqlite3.Error) as error:
            raise FlashError(
                f"{path}: flash cannot be opened: {error}; check folder, rights and free space"
            ) from error
        rows = self.query("SELECT name, id, boot FROM member")
        self._members = {name: (number, boot) for name, number, boot in rows}

    def partition(self, name: str) -> Partition:
        """One member's part."""
        return Partition(self, *self._members[name])

    @contextmanager
    def commit(self) -> Iterator[None]:
        """Make what partitions write inside of the block durable at its end, all or nothing."""
        with self.writing():
            self.db.execute("BEGIN IMMEDIATE")
        try:
            yield
            with self.writing():
                self.db.execute("COMMIT")
        finally:
            if self.db.in_transaction:
                self.db.execute("ROLLBACK")

    def query(self, statement: str, *values: int) -> list[tuple[Any, ...]]:
        """Read."""
        try:
            return self.db.execute(statement, values).fetchall()
        except sqlite3.Error as error:
            raise FlashError(f"{self._path}: flash cannot be read: {error}") from error

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Say what went wrong in our words."""
        try:
            yield
        except sqlite3.Error as error:
            raise FlashError(
                f"{self._path}: flash cannot be written: {error}; make room, sampling goes on "
                "and gaps will tell"
            ) from error

    def close(self) -> None:
        """Close the file."""
        self.db.close()
        self._owner.close()


class Partition:
    """A member's chip; its transactions are part of one for many where the storage has begun one.

    Attributes:
        boot: Number of this start.
    """

    __slots__ = ("_member", "_part", "_storage", "_uncounted", "boot")

    def __init__(self, storage: Storage, member: int, boot: int) -> None:
        self._storage = storage
        self._member = member
        self._part = self._uncounted = False
        self.boot = boot

    def restart(self) -> None:
        """Count another boot, durably; if that fails, the number stays as it was."""
        self.begin()
        try:
            self._count(self.boot + 1)
            self.commit()
        except FlashError:
            self.roll_back()
            raise
        self.boot += 1

    def begin(self) -> None:
        """Begin a transaction, or a part of the storage's one for many."""
        self._part = self._storage.db.in_transaction
        with self._storage.writing():
            self._storage.db.execute("SAVEPOINT part" if self._part else "BEGIN IMMEDIATE")
        if self._uncounted:
            self._count(self.boot)

    def commit(self) -> None:
        """End it; what is a part becomes durable with the whole."""
        with self._storage.writing():
            self._storage.db.execute("RELEASE part" if self._part else "COMMIT")
        self._uncounted = False

    def roll_back(self) -> None:
        """Undo it, if one is open."""
        if not self._storage.db.in_transaction:
            return
        with self._storage.writing():
            self._storage.db.execute("ROLLBACK TO part" if self._part else "ROLLBACK")
            if self._part:
                self._storage.db.execute("RELEASE part")

    def recount(self) -> None:
        """The storage undid what it was told: count the boot again, before anything else."""
        self._uncounted = True

    def _count(self, boot: int) -> None:
        with self._storage.writing():
            self._storage.db.execute(
                "UPDATE member SET boot = ? WHERE id = ?", (boot, self._member)
            )

    def append(self, boot: int, record: Record, shelf: int) -> None:
        """Keep a message on a shelf."""
        place = self._member, boot, record.sequence, shelf, record.earliest, record.latest
        rest = record.samples, 1 + record.named, record.kind, record.body
        with self._storage.writing():
            self._storage.db.execute(
                "INSERT OR REPLACE INTO message VALUES (?,?,?,?,?,?,?,?,?,?)", (*place, *rest)
            )

    def delete(self, boot: int, first: int, last: int) -> tuple[int, int]:
        """Delete from the first to the last sequence; gives how many, and their bytes."""
        with self._storage.writing():
            rows = self._storage.db.execute(
                "DELETE FROM message WHERE member = ? AND boot = ? AND sequence BETWEEN ? AND ? "
                "RETURNING length(body)",
                (self._member, boot, first, last),
            ).fetchall()
        return len(rows), sum(row[0] for row in rows)

    def read(self, position: Position) -> Kept | None:
        """One message; ``None`` if it is gone."""
        found = self._select("AND boot = ? AND sequence = ?", *position)
        return found[0] if found else None

    def after(self, position: Position, limit: int) -> list[Kept]:
        """The next messages behind a position, in order."""
        condition = "AND (boot, sequence) > (?, ?) ORDER BY boot, sequence LIMIT ?"
        return self._select(condition, *position, limit)

    def oldest(self, shelf: int) -> Kept | None:
        """The first message of a shelf."""
        found = self._select("AND shelf = ? ORDER BY boot, sequence LIMIT 1", shelf)
        return found[0] if found else None

    def level(self) -> tuple[int, int]:
        """How many messages it keeps, and their bytes."""
        rows = self._storage.query(
            "SELECT count(*), coalesce(sum(length(body)), 0) FROM message WHERE member = ?",
            self._member,
        )
        return rows[0][0], rows[0][1]

    def gaps(self) -> int:
        """How many gaps were ever recorded."""
        rows = self._storage.query("SELECT gaps FROM member WHERE id = ?", self._member)
        gaps: int = rows[0][0]
        return gaps

    def keep_gaps(self, gaps: int) -> None:
        """Keep that number."""
        with self._storage.writing():
            self._storage.db.execute(
                "UPDATE member SET gaps = ?1 WHERE id = ?2 AND gaps <> ?1", (gaps, self._member)
            )

    def answer(self) -> bytes | None:
        """The last result, also after it was acknowledged."""
        rows = self._storage.query("SELECT body FROM answer WHERE member = ?", self._member)
        return rows[0][0] if rows else None

    def keep_answer(self, body: bytes) -> None:
        """Keep the last result apart from the messages."""
        with self._storage.writing():
            self._storage.db.execute(
                "INSERT OR REPLACE INTO answer VALUES (?, ?)", (self._member, body)
            )

    def charge(self) -> bytes:
        """Nothing: a fleet's supplies never end."""
        return b""

    def keep_charge(self, body: bytes) -> None:
        """There is nothing to keep."""

    def _select(self, condition: str, *values: int) -> list[Kept]:
        statement = f"{_SELECT} WHERE member = ? {condition}"
        return [
            Kept((boot, sequence), kind, body, (earliest, latest), samples, stands_for)
            for boot, sequence, kind, body, earliest, latest, samples, stands_for in (
                self._storage.query(statement, self._member, *values)
            )
        ]
