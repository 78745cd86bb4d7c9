"""A node's flash: every message waits here until a gateway acknowledges it."""

from __future__ import annotations

import sqlite3
import threading
import time
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from eskin.errors import FlashError, LockedError
from eskin.lockfile import LockFile
from eskin.messages import Kind, Position, Result
from sensor_node.batch import Batch
from sensor_node.losses import Loss
from sensor_node.stored import SCHEMA, WEIGHTS, Stored, record_of
from sensor_node.usage import Usage

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from sensor_node.firmware.record import Record

_INSERT: Final = "INSERT OR REPLACE INTO message VALUES (?,?,?,?,?,?,?,?,?)"
_COUNT: Final = "UPDATE counter SET value = iif(value, value + 1, ?) WHERE name = 'boot'"
_GAP_RESERVE: Final = 2048
"""Room that is kept for the gap message which tells of an eviction."""

FULL: Final = "flash full"
FAILED: Final = "flash write failed"


@dataclass(slots=True)
class _Level:
    messages: int
    used: int
    gaps: int


class Flash:
    """Durable outbox of a node, safe for several threads.

    Opening counts the boot, durably, before anyone can use its number. Every batch is one
    synchronised commit. Over its capacity the oldest raw blocks give way first, then the oldest
    other messages, and a gap message names what was lost.

    Args:
        path: Database file; made if missing.
        capacity: Bytes of messages that it may hold.
        epoch: Number of the first boot of a fresh flash; ``None`` takes the present in seconds, so
            that a flash that was wiped or replaced starts above all numbers that the node has used
            before, which others remember.

    Raises:
        FlashError: It cannot be opened.
    """

    def __init__(self, path: Path, *, capacity: int, epoch: int | None = None) -> None:
        self._path = path
        self._capacity = capacity
        self._lock = threading.RLock()
        try:
            self._owner = LockFile(path)
            self._db = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = FULL")
            self._db.executescript(SCHEMA)
            self._db.execute(_COUNT, (int(time.time()) if epoch is None else epoch,))
            counters = dict(self._db.execute("SELECT name, value FROM counter").fetchall())
            self._messages, self._used = self._db.execute(
                "SELECT count(*), coalesce(sum(length(body)), 0) FROM message"
            ).fetchone()
        except LockedError as error:
            raise FlashError(f"{path}: another node runs on this flash; stop it first") from error
        except (OSError, sqlite3.Error) as error:
            raise FlashError(
                f"{path}: flash cannot be opened: {error}; check folder, rights and free space"
            ) from error
        self.boot: int = counters["boot"]
        self._gaps: int = counters["gaps"]
        self._sequence = self._settled = 0
        # What no gap message could say yet, because nothing could be written.
        self._unsaid = Loss(FAILED)
        # The last gap of an eviction, still open to more as long as nobody has read it.
        self._open: tuple[Position, Loss] | None = None

    def restart(self) -> None:
        """Count a boot of the machine, durably; everything that waits stays.

        Raises:
            FlashError: It could not be written; the number stays as it was.
        """
        with self._lock:
            try:
                self._db.execute(_COUNT, (self.boot + 1,))
            except sqlite3.Error as error:
                raise FlashError(f"{self._path}: flash cannot be written: {error}") from error
            self.boot += 1
            self._sequence = self._settled = 0
            self._open = None

    def next_position(self) -> Position:
        """Give out the next position; only for use inside of a batch."""
        return Position(self.boot, self.next_sequence())

    def next_sequence(self) -> int:
        """The same, within this boot."""
        self._sequence += 1
        return self._sequence - 1

    @contextmanager
    def batch(self) -> Iterator[Batch]:
        """Collect messages; leaving the block makes them durable in one commit.

        Raises:
            FlashError: They could not be written. They are lost then, and the next batch that can
                be written tells so in a gap.
        """
        with self._lock:
            batch = Batch(self)
            try:
                if self._unsaid.time is not None:
                    batch.add(self._unsaid.gap(batch.position()))
                yield batch
                self._commit(batch.records)
            except (sqlite3.Error, FlashError) as error:
                told = 1 if self._unsaid.time is not None else 0
                for record in batch.records[:told]:
                    self._unsaid.skip(Position(self.boot, record.sequence))
                for record in batch.records[told:]:
                    self._unsaid.take(
                        time=(record.earliest, record.latest),
                        samples=record.samples,
                        position=Position(self.boot, record.sequence),
                    )
                raise FlashError(
                    f"{self._path}: {len(batch.records)} messages could not be stored: {error}; "
                    "make room, sampling goes on and a gap will tell"
                ) from error
            self._unsaid = Loss(FAILED)
            self._settled = self._sequence

    def pending(self, after: Position | None, limit: int) -> list[Stored]:
        """The oldest waiting messages behind a position."""
        start = after or Position(-1, -1)
        with self._lock:
            rows = self._query(
                "SELECT boot, sequence, kind, body FROM message WHERE (boot, sequence) > (?, ?) "
                "ORDER BY boot, sequence LIMIT ?",
                (start.boot, start.sequence, limit),
            )
            found = [Stored(Position(row[0], row[1]), row[2], row[3]) for row in rows]
            if self._open and any(stored.position == self._open[0] for stored in found):
                self._open = None
            return found

    def read(self, position: Position) -> Stored | None:
        """One waiting message; ``None`` if it is gone."""
        with self._lock:
            rows = self._query(
                "SELECT kind, body FROM message WHERE boot = ? AND sequence = ?",
                (position.boot, position.sequence),
            )
            if self._open and self._open[0] == position:
                self._open = None
            return Stored(position, rows[0][0], rows[0][1]) if rows else None

    def answer(self) -> Result | None:
        """The last result that was stored, also after it was acknowledged.

        Raises:
            FlashError: It cannot be read.
        """
        with self._lock:
            rows = self._query("SELECT body FROM answer", ())
        return Result.decode(rows[0][0]) if rows else None

    def held(self) -> Position:
        """A position below which nothing waits or will come."""
        with self._lock:
            rows = self._query(
                "SELECT boot, sequence FROM message ORDER BY boot, sequence LIMIT 1", ()
            )
            settled = Position(self.boot, self._settled)
            return min(settled, Position(*rows[0])) if rows else settled

    def forget(self, spans: Iterable[tuple[int, int, int]]) -> None:
        """Forget messages that a gateway acknowledged.

        Args:
            spans: ``(boot, first, last)``.

        Raises:
            FlashError: The file cannot be written; they stay, and are sent again.
        """
        with self._lock:
            freed = count = 0
            try:
                self._db.execute("BEGIN IMMEDIATE")
                try:
                    for span in spans:
                        rows = self._db.execute(
                            "DELETE FROM message WHERE boot = ? AND sequence BETWEEN ? AND ? "
                            "RETURNING length(body)",
                            span,
                        ).fetchall()
                        count += len(rows)
                        freed += sum(row[0] for row in rows)
                    self._db.execute("COMMIT")
                finally:
                    self._roll_back()
            except sqlite3.Error as error:
                raise FlashError(f"{self._path}: flash cannot be written: {error}") from error
            self._messages, self._used = self._messages - count, self._used - freed

    def usage(self) -> Usage:
        """How full it is."""
        with self._lock:
            return Usage(self._messages, self._used, self._capacity, self._gaps)

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._db.close()
            self._owner.close()

    def _query(self, statement: str, values: tuple[int, ...]) -> list[tuple[Any, ...]]:
        try:
            return self._db.execute(statement, values).fetchall()
        except sqlite3.Error as error:
            raise FlashError(f"{self._path}: flash cannot be read: {error}") from error

    def _commit(self, records: list[Record]) -> None:
        if not records:
            return
        level = _Level(self._messages, self._used, self._gaps)
        opened = deepcopy(self._open)
        self._db.execute("BEGIN IMMEDIATE")
        try:
            for record in records:
                self._insert(record, level)
            if level.used > self._capacity:
                opened = self._evict(level, opened)
            self._db.execute("UPDATE counter SET value = ? WHERE name = 'gaps'", (level.gaps,))
            self._db.execute("COMMIT")
        finally:
            self._roll_back()
        self._messages, self._used, self._gaps = level.messages, level.used, level.gaps
        self._open = opened

    def _insert(self, record: Record, level: _Level) -> None:
        weight = WEIGHTS.get(record.kind, 1)
        place = (self.boot, record.sequence, weight, record.earliest, record.latest)
        self._db.execute(
            _INSERT, (*place, record.samples, 1 + record.named, record.kind, record.body)
        )
        if record.kind == Kind.RESULT:
            self._db.execute("INSERT OR REPLACE INTO answer VALUES (1, ?)", (record.body,))
        level.messages += 1
        level.used += len(record.body)
        level.gaps += record.kind == Kind.GAP

    def _evict(self, level: _Level, opened: tuple[Position, Loss] | None) -> tuple[Position, Loss]:
        """Make room, oldest blocks first; gives the gap that tells of it and may still grow."""
        position, loss = opened or (self.next_position(), Loss(FULL))
        if opened is not None:
            self._remove(position, level)
            level.gaps -= 1
        while level.used > self._capacity - _GAP_RESERVE:
            row = self._db.execute(
                "SELECT boot, sequence, earliest, latest, samples, stands_for FROM message "
                "ORDER BY weight, boot, sequence LIMIT 1"
            ).fetchone()
            if row is None:
                break
            if loss.full:
                self._insert(record_of(loss.gap(position)), level)
                position, loss = self.next_position(), Loss(FULL)
            victim = Position(row[0], row[1])
            self._remove(victim, level)
            loss.take(time=(row[2], row[3]), samples=row[4], messages=row[5], position=victim)
        self._insert(record_of(loss.gap(position)), level)
        return position, loss

    def _remove(self, position: Position, level: _Level) -> None:
        freed = self._db.execute(
            "DELETE FROM message WHERE boot = ? AND sequence = ? RETURNING length(body)",
            (position.boot, position.sequence),
        ).fetchone()
        if freed is not None:
            level.messages -= 1
            level.used -= freed[0]

    def _roll_back(self) -> None:
        if self._db.in_transaction:
            self._db.execute("ROLLBACK")
