"""The durable spool: one SQLite file (WAL).

What the nodes said is committed with ``synchronous=FULL``: it survives a power cut before anybody
acknowledges it. What the cloud answered is committed with ``synchronous=NORMAL``: losing that word
costs only sending again, which is always safe.
"""

from __future__ import annotations

import hashlib
import json
import logging
import sqlite3
import time
from contextlib import ExitStack, closing, contextmanager
from threading import Event, Lock
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from eskin.errors import LockedError, SpoolError
from eskin.runtime.digest import row_checksum
from eskin.runtime.files.lock import LockFile
from eskin.runtime.sqlite_integrity import UNREADABLE, require_whole, why
from eskin.wire.messages import Position
from eskin.wire.sequence_set import SequenceRanges
from eskin_gateway.spool.batch import DeadLetter, Sender
from eskin_gateway.spool.disk_reserve import DiskReserve
from eskin_gateway.spool.node_state import NodeState
from eskin_gateway.spool.schema import connect, prepare
from eskin_gateway.spool.statistics import SpoolStatistics

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence
    from pathlib import Path

    from eskin_gateway.spool.batch import Batch

log = logging.getLogger(__name__)

RESERVE: Final = 8_000_000
"""Bytes kept back on the disk: twice the log (WAL) at its longest, which a checkpoint needs."""
_ADD_MESSAGE: Final = """INSERT INTO messages (node, received, body, boot, sequence, digest)
    VALUES (?, ?, ?, ?, ?, ?)"""
_OLDEST: Final = """SELECT id, node, received, body, boot, sequence, digest FROM messages
    WHERE id NOT IN (SELECT value FROM json_each(?))
    AND node NOT IN (SELECT value FROM json_each(?)) ORDER BY id LIMIT ?"""
_FORGET: Final = "DELETE FROM messages WHERE id BETWEEN ? AND ?"
_CONFIRM: Final = """INSERT INTO confirmed VALUES (?, ?, ?)
    ON CONFLICT (node, boot) DO UPDATE SET last = max(last, excluded.last)"""
_TRIM_CONFIRMED: Final = """DELETE FROM confirmed WHERE ? < (SELECT count(*)
    FROM confirmed AS later WHERE later.node = confirmed.node AND later.boot >= confirmed.boot)"""
_MOST_BOOTS: Final = 16
"""Of a node: what the cloud confirmed of the latest ones is kept."""
_KEEP_NODE: Final = "INSERT OR REPLACE INTO nodes VALUES (?, ?, ?, ?, ?, ?, ?)"
_KEEP_SENDER: Final = "INSERT OR REPLACE INTO senders VALUES (?, ?, ?, ?)"
_ADD_LETTER: Final = """INSERT OR IGNORE INTO dead_letters (at, node, reason, body, digest)
    VALUES (?, ?, ?, ?, ?)"""
_DROP_LETTERS: Final = """DELETE FROM dead_letters WHERE id IN
    (SELECT id FROM dead_letters ORDER BY id LIMIT ?)"""


class Stored(NamedTuple):
    """One message in the spool; ``received`` in UTC ns."""

    id: int
    node: str
    received: int
    body: bytes
    boot: int | None = None
    sequence: int | None = None


class Spool:
    """A durable queue to the cloud, with all that must become durable with it.

    Args:
        path: SQLite file, made where there is none.
        capacity: Most bytes of messages.
        letters: Most dead letters.

    Raises:
        SpoolError: The file cannot be opened.
    """

    def __init__(self, path: Path, *, capacity: int, letters: int) -> None:
        self._path = path
        self._capacity = capacity
        self._letters_most = letters
        self._lock = Lock()
        self._dropped = 0
        self.filled = Event()
        try:
            with ExitStack() as opened:
                self._open(path, opened)
                opened.pop_all()
        except LockedError as error:
            raise SpoolError(
                f"spool {path}: another gateway runs on it; stop it first, or give each its own"
            ) from error
        except (OSError, *UNREADABLE) as error:
            raise SpoolError(f"spool {path} cannot be opened: {why(error)}") from error

    def _open(self, path: Path, opened: ExitStack) -> None:
        """Open all of it; what was opened before a failure is closed again."""
        self._owner = opened.enter_context(LockFile(path))
        self._intake = opened.enter_context(closing(connect(path, "FULL")))
        require_whole(self._intake)
        prepare(self._intake)
        self._intake.execute(_TRIM_CONFIRMED, (_MOST_BOOTS,))
        self._outlet = opened.enter_context(closing(connect(path, "NORMAL")))
        # Nodes show new ones with each status; the last one says to which site each belongs.
        self._intake.execute(
            "DELETE FROM senders WHERE expires < ? AND thumbprint NOT IN "
            "(SELECT thumbprint FROM nodes WHERE thumbprint IS NOT NULL)",
            (int(time.time()),),
        )
        self._messages, self._used = self._intake.execute(
            "SELECT count(*), coalesce(sum(length(body)), 0) FROM messages"
        ).fetchone()
        self._reserve = DiskReserve(path.with_name(f"{path.name}.reserve"), size=RESERVE)
        self._letters = self._intake.execute("SELECT count(*) FROM dead_letters").fetchone()[0]

    def close(self) -> None:
        """Close the file; what was committed stays."""
        with self._lock:
            self._intake.close()
            self._outlet.close()
            self._owner.close()

    def commit(self, batch: Batch) -> None:
        """Make a batch durable, all of it or nothing.

        Raises:
            SpoolError: There is no room, or the file cannot be written.
        """
        if not self._reserve.hold():
            raise SpoolError(
                f"spool is full: the disk of {self._path} has no room; make some, or wait until "
                "the cloud takes messages"
            )
        size = batch.size
        if self._used + size > self._capacity:
            raise SpoolError(
                f"spool is full: {self._used} of {self._capacity} bytes; {size} more do not fit "
                "until the cloud takes some, or spool.capacity_bytes grows"
            )
        with self._lock:
            with self._transaction(self._intake) as connection:
                entries = [(*entry, row_checksum(entry)) for entry in batch.entries]
                connection.executemany(_ADD_MESSAGE, entries)
                connection.executemany(_KEEP_NODE, [_row(*node) for node in batch.nodes.items()])
                connection.executemany(_KEEP_SENDER, batch.node_certificates)
                buried = self._bury(connection, batch.dead)
            self._messages += len(batch.entries)
            self._used += size
            self._count_letters(*buried)
        if batch.entries:
            self.filled.set()

    def take(
        self,
        most: int,
        most_bytes: int,
        *,
        besides: Collection[int] = (),
        without: Collection[str] = (),
    ) -> list[Stored]:
        """The oldest messages, in order; they stay until they are settled.

        What is not as it was committed becomes a dead letter, and is not given.

        Args:
            most: Most messages.
            most_bytes: Most bytes; one message is given in any case.
            besides: Ids of messages that are left out.
            without: Nodes whose messages are left out.

        Raises:
            SpoolError: The file cannot be read.
        """
        self.filled.clear()
        here = json.dumps([*besides]), json.dumps([*without]), most
        while True:
            taken, damaged = self._take(here, most_bytes)
            if damaged:
                self._give_up(damaged)
            if taken or not damaged:
                return taken

    def _take(
        self, here: tuple[str, str, int], most_bytes: int
    ) -> tuple[list[Stored], list[Stored]]:
        """The oldest messages, and the damaged ones that were met on the way."""
        taken: list[Stored] = []
        damaged: list[Stored] = []
        size = 0
        try:
            with closing(self._outlet.execute(_OLDEST, here)) as cursor:
                for *values, digest in cursor:
                    message = Stored(*values)
                    if row_checksum(message[1:]) != digest:
                        body = values[3] if isinstance(values[3], bytes) else b""
                        damaged.append(message._replace(body=body))
                        continue
                    size += len(message.body)
                    if taken and size > most_bytes:
                        break
                    taken.append(message)
        except UNREADABLE as error:
            raise SpoolError(f"spool {self._path} cannot be read: {why(error)}") from error
        return taken, damaged

    def _give_up(self, damaged: Sequence[Stored]) -> None:
        """Keep damaged messages as dead letters; the cloud will miss their numbers."""
        letters = []
        for _, node, _, body, boot, sequence in damaged:
            place = f"boot {boot} sequence {sequence}"
            log.error("message damaged in the spool: path=%s node=%s %s", self._path, node, place)
            reason = f"{place}: damaged in the spool: see whether the disk fails"
            letters.append(DeadLetter(time.time_ns(), str(node), reason, body))
        self.settle(damaged, letters)

    def settle(
        self,
        stored: Sequence[Stored],
        dead: Sequence[DeadLetter] = (),
        *,
        confirmed: Sequence[Stored] = (),
    ) -> None:
        """Forget messages that the cloud answered for; what it rejected stays as dead letters.

        Args:
            stored: All that it answered for.
            dead: What it rejected.
            confirmed: What it says that it has: where that ends in each boot is remembered.

        Raises:
            SpoolError: The file cannot be written; nothing is forgotten.
        """
        with self._lock:
            try:
                buried = self._forget(stored, dead, confirmed)
            except SpoolError:
                if not self._reserve.release():
                    raise
                log.warning("disk full, reserve given up to empty the spool: path=%s", self._path)
                buried = self._forget(stored, dead, confirmed)
            self._messages -= len(stored)
            self._used -= sum(len(message.body) for message in stored)
            self._count_letters(*buried)
            if not self._reserve.held:
                self._regain()

    def node(self, name: str) -> NodeState | None:
        """What is remembered of a node; nothing where that is damaged.

        What it forgets so, and sees again, the cloud knows to be stored.

        Raises:
            SpoolError: The file cannot be read.
            MessageError: Another program wrote it.
        """
        rows = self._rows("SELECT * FROM nodes WHERE node = ?", name)
        if not rows:
            return None
        *values, digest = rows[0]
        _, boot, sequence, ranges, status, thumbprint = values
        if row_checksum(values) != digest:
            log.error("record damaged, and forgotten: path=%s node=%s", self._path, name)
            return None
        return NodeState.restore(Position(boot, sequence), ranges, status, thumbprint)

    def confirmed(self) -> list[tuple[str, int, int]]:
        """Node, boot, and the greatest number of it that the cloud confirmed, of latest boots.

        Raises:
            SpoolError: The file cannot be read.
        """
        rows = self._rows("SELECT node, boot, last FROM confirmed ORDER BY node, boot")
        return [(node, boot, last) for node, boot, last in rows]

    def nodes(self) -> list[str]:
        """Names of all nodes ever accepted.

        Raises:
            SpoolError: The file cannot be read.
        """
        return [row[0] for row in self._rows("SELECT node FROM nodes ORDER BY node")]

    def sender(self, thumbprint: bytes) -> Sender | None:
        """A sender's certificates.

        Raises:
            SpoolError: The file cannot be read.
        """
        rows = self._rows("SELECT * FROM senders WHERE thumbprint = ?", thumbprint)
        return Sender(*rows[0]) if rows else None

    def dead_letters(self) -> list[DeadLetter]:
        """All dead letters, the oldest first.

        Raises:
            SpoolError: The file cannot be read.
        """
        rows = self._rows("SELECT at, node, reason, body FROM dead_letters ORDER BY id")
        return [DeadLetter(*row) for row in rows]

    def oldest(self) -> int | None:
        """When the oldest message came, UTC ns.

        Raises:
            SpoolError: The file cannot be read.
        """
        rows = self._rows("SELECT received FROM messages ORDER BY id LIMIT 1")
        return rows[0][0] if rows else None

    @property
    def statistics(self) -> SpoolStatistics:
        """How it fares now."""
        with self._lock:
            return SpoolStatistics(
                self._messages, self._used, self._capacity, self._letters, self._dropped
            )

    def _rows(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        try:
            with self._lock:
                return self._intake.execute(query, values).fetchall()
        except UNREADABLE as error:
            raise SpoolError(f"spool {self._path} cannot be read: {why(error)}") from error

    def _forget(
        self,
        stored: Sequence[Stored],
        dead: Sequence[DeadLetter],
        confirmed: Sequence[Stored],
    ) -> tuple[int, int]:
        ends: dict[tuple[str, int], int] = {}
        for message in confirmed:
            if message.boot is not None and message.sequence is not None:
                place = message.node, message.boot
                ends[place] = max(message.sequence, ends.get(place, 0))
        with self._transaction(self._outlet) as connection:
            connection.executemany(_CONFIRM, [(*place, last) for place, last in ends.items()])
            for first, last in SequenceRanges((message.id, message.id) for message in stored):
                connection.execute(_FORGET, (first, last))
            return self._bury(connection, dead)

    def _regain(self) -> None:
        """Fold the log into the file, which frees its room, and keep the room back again."""
        try:
            self._outlet.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        except sqlite3.Error as error:
            log.warning("spool not folded yet: path=%s error=%s", self._path, error)
        if self._reserve.hold():
            log.info("reserve held again: path=%s", self._path)

    @contextmanager
    def _transaction(self, connection: sqlite3.Connection) -> Iterator[sqlite3.Connection]:
        try:
            connection.execute("BEGIN IMMEDIATE")
            yield connection
            connection.execute("COMMIT")
        except UNREADABLE as error:
            # A full disk may have ended the transaction already.
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            raise SpoolError(f"spool {self._path} cannot be written: {why(error)}") from error

    def _bury(self, connection: sqlite3.Connection, dead: Sequence[DeadLetter]) -> tuple[int, int]:
        """Keep dead letters, each content once; gives how many came and how many gave way."""
        if not dead:
            return 0, 0
        rows = [
            (*letter[:4], letter.mark or hashlib.sha256(letter.body).digest()) for letter in dead
        ]
        added = connection.executemany(_ADD_LETTER, rows).rowcount
        surplus = self._letters + added - self._letters_most
        if surplus <= 0:
            return added, 0
        return added, connection.execute(_DROP_LETTERS, (surplus,)).rowcount

    def _count_letters(self, added: int, dropped: int) -> None:
        self._letters += added - dropped
        self._dropped += dropped


def _row(name: str, record: NodeState) -> tuple[object, ...]:
    held, ranges = record.held, record.encode_ranges()
    values = name, held.boot, held.sequence, ranges, record.status, record.thumbprint
    return *values, row_checksum(values)
