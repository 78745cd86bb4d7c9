"""The durable spool: one SQLite file (WAL).

Messages of nodes are committed with ``synchronous=FULL``: they survive a power cut before the
gateway acknowledges them. Results of the cloud are committed with ``synchronous=NORMAL``: if one is
lost, the gateway sends the messages again, and the cloud drops them as duplicates.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import sqlite3
import time
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from threading import Event, Lock
from typing import TYPE_CHECKING, Any, Final

from eskin.errors import LockedError, SpoolError
from eskin.runtime.digest import row_checksum
from eskin.runtime.files.lock import LockFile
from eskin.runtime.sqlite_integrity import UNREADABLE, require_whole, why
from eskin.wire.frames import content_hash
from eskin.wire.messages import Position
from eskin.wire.sequence_set import SequenceRanges
from eskin_gateway.spool.batch import DeadLetter, NodeCertificate, SpoolMessage
from eskin_gateway.spool.node_state import NodeState

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence
    from pathlib import Path

    from eskin_gateway.spool.batch import Batch


log = logging.getLogger(__name__)

RESERVE: Final = 8_000_000
"""Bytes reserved on the disk: twice the longest log (WAL), which a checkpoint needs."""
_INSERT_MESSAGE: Final = """INSERT INTO messages (node, received, body, boot, sequence, digest)
    VALUES (?, ?, ?, ?, ?, ?)"""
_SELECT_OLDEST: Final = """SELECT node, received, body, boot, sequence, id, digest FROM messages
    WHERE id NOT IN (SELECT value FROM json_each(?))
    AND node NOT IN (SELECT value FROM json_each(?)) ORDER BY id LIMIT ?"""
_DELETE_MESSAGES: Final = "DELETE FROM messages WHERE id BETWEEN ? AND ?"
_CONFIRM: Final = """INSERT INTO confirmed VALUES (?, ?, ?) ON CONFLICT (node, boot)
    DO UPDATE SET last_sequence = max(last_sequence, excluded.last_sequence)"""
_TRIM_CONFIRMED: Final = """DELETE FROM confirmed WHERE ? < (SELECT count(*)
    FROM confirmed AS later WHERE later.node = confirmed.node AND later.boot >= confirmed.boot)"""
_MAX_CONFIRMED_BOOTS: Final = 16
"""The latest boots of a node whose confirmed sequences are stored."""
_REPLACE_NODE: Final = "INSERT OR REPLACE INTO nodes VALUES (?, ?, ?, ?, ?, ?, ?)"
_REPLACE_CERTIFICATE: Final = "INSERT OR REPLACE INTO certificates VALUES (?, ?, ?, ?)"
_TRIM_CERTIFICATES: Final = """DELETE FROM certificates WHERE expires < ? AND thumbprint NOT IN
    (SELECT thumbprint FROM nodes WHERE thumbprint IS NOT NULL)"""
_INSERT_DEAD_LETTER: Final = """INSERT OR IGNORE INTO dead_letters
    (time, node, reason, body, fingerprint) VALUES (?, ?, ?, ?, ?)"""
_DELETE_DEAD_LETTERS: Final = """DELETE FROM dead_letters WHERE id IN
    (SELECT id FROM dead_letters ORDER BY id LIMIT ?)"""
_CHECKPOINT_PAGES: Final = 1000
_REPLACE_DESCRIPTION: Final = "INSERT OR REPLACE INTO descriptions VALUES (?, ?, ?)"
_DELETE_DESCRIPTION: Final = "DELETE FROM descriptions WHERE node = ? AND hash = ?"
_REPLACE_LAYOUT: Final = "INSERT OR REPLACE INTO layouts VALUES (?, ?, ?)"
_DELETE_LAYOUT: Final = "DELETE FROM layouts WHERE node = ? AND hash = ?"
_SELECT_IN_USE: Final = """SELECT hash FROM layouts WHERE node = ?
    AND last_message >= (SELECT min(id) FROM messages)"""
VERSION: Final = 2
_TABLES: Final = (
    # digest: of all columns but the id; no signature covers a decrypted message.
    # AUTOINCREMENT: ids are never reused, so their order is the order of acceptance.
    """CREATE TABLE messages (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        node TEXT NOT NULL,
        received INTEGER NOT NULL,
        body BLOB NOT NULL,
        boot INTEGER,
        sequence INTEGER,
        digest INTEGER NOT NULL
    ) STRICT""",
    """CREATE TABLE nodes (
        node TEXT PRIMARY KEY,
        held_boot INTEGER NOT NULL,
        held_sequence INTEGER NOT NULL,
        ranges BLOB NOT NULL,
        status BLOB,
        thumbprint BLOB,
        digest INTEGER NOT NULL
    ) STRICT, WITHOUT ROWID""",
    # The last sequence of each boot that the cloud has confirmed.
    """CREATE TABLE confirmed (
        node TEXT NOT NULL,
        boot INTEGER NOT NULL,
        last_sequence INTEGER NOT NULL,
        PRIMARY KEY (node, boot)
    ) STRICT, WITHOUT ROWID""",
    """CREATE TABLE certificates (
        thumbprint BLOB PRIMARY KEY,
        expires INTEGER NOT NULL,
        leaf BLOB NOT NULL,
        issuer BLOB NOT NULL
    ) STRICT, WITHOUT ROWID""",
    """CREATE TABLE dead_letters (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        time INTEGER NOT NULL,
        node TEXT NOT NULL,
        reason TEXT NOT NULL,
        body BLOB NOT NULL,
        fingerprint BLOB NOT NULL UNIQUE
    ) STRICT""",
)
_TABLES_OF_FRAMES: Final = (
    # Patches and layouts. The hash is that of the body.
    """CREATE TABLE descriptions (
        node TEXT NOT NULL,
        hash BLOB NOT NULL,
        body BLOB NOT NULL,
        PRIMARY KEY (node, hash)
    ) STRICT""",
    # The last message that named a layout: as long as there is an older one in the spool, the
    # spool may have messages that need the layout.
    """CREATE TABLE layouts (
        node TEXT NOT NULL,
        hash BLOB NOT NULL,
        last_message INTEGER NOT NULL,
        PRIMARY KEY (node, hash)
    ) STRICT, WITHOUT ROWID""",
)


class DiskReserve:
    """A file that only takes space, until the space is needed.

    Deleting rows needs space, too: without a reserve, a spool on a full disk could not delete what
    the cloud has stored.

    Args:
        path: The file.
        size: Bytes to reserve. Half of them are enough.
    """

    def __init__(self, path: Path, *, size: int) -> None:
        self._path = path
        self._size = size
        self.held = False
        self.hold()

    def hold(self) -> bool:
        """Reserve the space if it is not held; return whether it is held now."""
        for size in (self._size, self._size // 2):
            self.held = self.held or self._allocate(size)
        return self.held

    def release(self) -> bool:
        """Release the space; return whether it was held."""
        held, self.held = self.held, False
        self._path.unlink(missing_ok=True)
        return held

    def _allocate(self, size: int) -> bool:
        try:
            descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError:
            return False
        try:
            os.posix_fallocate(descriptor, 0, size)
            os.ftruncate(descriptor, size)
        except OSError:
            with suppress(OSError):
                self._path.unlink()
            return False
        finally:
            os.close(descriptor)
        return True


def create_tables(connection: sqlite3.Connection) -> None:
    """Create the tables of a new file, or those that an older one lacks, in one transaction.

    Raises:
        SpoolError: The file has another version.
    """
    version: int = connection.execute("PRAGMA user_version").fetchone()[0]
    if not 0 <= version <= VERSION:
        raise SpoolError(
            f"spool has version {version}, this gateway knows {VERSION}; "
            "run the gateway that made it, or choose another spool.path"
        )
    if version < VERSION:
        connection.execute("BEGIN IMMEDIATE")
        for statement in (*(_TABLES if version == 0 else ()), *_TABLES_OF_FRAMES):
            connection.execute(statement)
        connection.execute(f"PRAGMA user_version = {VERSION}")
        connection.execute("COMMIT")


def connect(path: Path, synchronous: str) -> sqlite3.Connection:
    """Open the file; ``synchronous`` is ``FULL`` for durable commits, else ``NORMAL``."""
    connection = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
    # A damaged text is decoded to another text, which the row's digest detects.
    connection.text_factory = lambda text: text.decode(errors="replace")
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute(f"PRAGMA synchronous = {synchronous}")
    # Debian's SQLite overwrites deleted rows: twice the writing, for data that the cloud has.
    connection.execute("PRAGMA secure_delete = OFF")
    connection.execute(f"PRAGMA wal_autocheckpoint = {_CHECKPOINT_PAGES}")
    connection.execute("PRAGMA busy_timeout = 5000")
    return connection


@dataclass(frozen=True, slots=True)
class SpoolStatistics:
    """State of the spool.

    Attributes:
        messages: Messages waiting for the cloud.
        used: Their bytes.
        capacity: Most bytes.
        dead_letters: Stored dead letters.
        dead_letters_dropped: Dead letters dropped since the start, because newer ones came.
    """

    messages: int
    used: int
    capacity: int
    dead_letters: int
    dead_letters_dropped: int


class Spool:
    """A durable queue of messages to the cloud, and the state of nodes. Thread-safe.

    Args:
        path: SQLite file, created if missing.
        capacity: Most bytes of messages.
        max_dead_letters: Most dead letters.

    Raises:
        SpoolError: The file cannot be opened.
    """

    def __init__(self, path: Path, *, capacity: int, max_dead_letters: int) -> None:
        self._path = path
        self._capacity = capacity
        self._max_dead_letters = max_dead_letters
        self._lock = Lock()
        self._dead_letters_dropped = 0
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
        """Open the file, and close it again after a failure."""
        self._lock_file = opened.enter_context(LockFile(path))
        self._ingest = opened.enter_context(closing(connect(path, "FULL")))
        require_whole(self._ingest)
        create_tables(self._ingest)
        self._ingest.execute(_TRIM_CONFIRMED, (_MAX_CONFIRMED_BOOTS,))
        self._forward = opened.enter_context(closing(connect(path, "NORMAL")))
        # The certificate that a node used last shows the node's site, also if it is expired.
        self._ingest.execute(_TRIM_CERTIFICATES, (int(time.time()),))
        self._messages, self._used = self._ingest.execute(
            "SELECT count(*), coalesce(sum(length(body)), 0) FROM messages"
        ).fetchone()
        self._reserve = DiskReserve(path.with_name(f"{path.name}.reserve"), size=RESERVE)
        (self._dead_letters,) = self._ingest.execute("SELECT count(*) FROM dead_letters").fetchone()

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._ingest.close()
            self._forward.close()
            self._lock_file.close()

    def commit(self, batch: Batch) -> None:
        """Commit a batch in one transaction.

        Raises:
            SpoolError: The spool is full, or the file cannot be written.
        """
        if not self._reserve.hold():
            raise SpoolError(
                f"spool is full: the disk of {self._path} has no space; free some, or wait until "
                "the cloud takes messages"
            )
        size = batch.size
        if self._used + size > self._capacity:
            raise SpoolError(
                f"spool is full: {self._used} of {self._capacity} bytes; {size} more do not fit "
                "until the cloud takes some, or spool.capacity_bytes is increased"
            )
        with self._lock:
            with self._transaction(self._ingest) as connection:
                connection.executemany(
                    _INSERT_MESSAGE, [(*m[:5], row_checksum(m[:5])) for m in batch.messages]
                )
                connection.executemany(_REPLACE_NODE, [_row(*item) for item in batch.nodes.items()])
                connection.executemany(_REPLACE_CERTIFICATE, batch.certificates)
                _write_descriptions(connection, batch)
                counts = self._insert_dead_letters(connection, batch.dead_letters)
            self._messages += len(batch.messages)
            self._used += size
            self._count_dead_letters(*counts)
        if batch.messages:
            self.filled.set()

    def take(
        self,
        most: int,
        most_bytes: int,
        *,
        without_ids: Collection[int] = (),
        without_nodes: Collection[str] = (),
    ) -> list[SpoolMessage]:
        """Read the oldest messages in order. They stay until they are settled.

        A damaged message becomes a dead letter and is not returned.

        Args:
            most: Most messages.
            most_bytes: Most bytes. One message is returned in any case.
            without_ids: Messages that are left out.
            without_nodes: Nodes whose messages are left out.

        Raises:
            SpoolError: The file cannot be read.
        """
        self.filled.clear()
        values = json.dumps([*without_ids]), json.dumps([*without_nodes]), most
        while True:
            messages, damaged = self._take(values, most_bytes)
            if damaged:
                self._reject_damaged(damaged)
            if messages or not damaged:
                return messages

    def _take(
        self, values: tuple[str, str, int], most_bytes: int
    ) -> tuple[list[SpoolMessage], list[SpoolMessage]]:
        """Read the oldest messages, and the damaged ones among them."""
        messages: list[SpoolMessage] = []
        damaged: list[SpoolMessage] = []
        size = 0
        try:
            with closing(self._forward.execute(_SELECT_OLDEST, values)) as cursor:
                for *columns, digest in cursor:
                    message = SpoolMessage(*columns)
                    if row_checksum(message[:5]) != digest:
                        body = columns[2] if isinstance(columns[2], bytes) else b""
                        damaged.append(message._replace(body=body))
                        continue
                    size += len(message.body)
                    if messages and size > most_bytes:
                        break
                    messages.append(message)
        except UNREADABLE as error:
            raise SpoolError(f"spool {self._path} cannot be read: {why(error)}") from error
        return messages, damaged

    def _reject_damaged(self, damaged: Sequence[SpoolMessage]) -> None:
        """Turn damaged messages into dead letters. The cloud will report them as missing."""
        dead_letters = []
        for message in damaged:
            position = f"boot {message.boot} sequence {message.sequence}"
            log.error("message damaged: path=%s node=%s %s", self._path, message.node, position)
            reason = f"{position}: damaged in the spool: check the disk"
            dead_letters.append(DeadLetter(time.time_ns(), str(message.node), reason, message.body))
        self.settle(damaged, dead_letters)

    def settle(
        self,
        messages: Sequence[SpoolMessage],
        dead_letters: Sequence[DeadLetter] = (),
        *,
        confirmed: Sequence[SpoolMessage] = (),
    ) -> None:
        """Delete messages that the cloud answered for, and store the rejected as dead letters.

        Args:
            messages: All that it answered for.
            dead_letters: What it rejected.
            confirmed: What it stored. The last sequence of each boot is remembered.

        Raises:
            SpoolError: The file cannot be written; nothing is deleted.
        """
        with self._lock:
            try:
                counts = self._delete(messages, dead_letters, confirmed)
            except SpoolError:
                if not self._reserve.release():
                    raise
                log.warning("disk full, reserve released: path=%s", self._path)
                counts = self._delete(messages, dead_letters, confirmed)
            self._messages -= len(messages)
            self._used -= sum(len(message.body) for message in messages)
            self._count_dead_letters(*counts)
            if not self._reserve.held:
                self._regain_reserve()

    def node(self, name: str) -> NodeState | None:
        """Read the state of a node; ``None`` if it is unknown or damaged.

        Without it, duplicates are accepted, and the cloud drops them.

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
            log.error("node state damaged and dropped: path=%s node=%s", self._path, name)
            return None
        return NodeState.restore(Position(boot, sequence), ranges, status, thumbprint)

    def confirmed(self) -> list[tuple[str, int, int]]:
        """Node, boot, and the last sequence of it that the cloud confirmed.

        Raises:
            SpoolError: The file cannot be read.
        """
        return self._rows("SELECT node, boot, last_sequence FROM confirmed ORDER BY node, boot")

    def nodes(self) -> list[str]:
        """Names of all nodes.

        Raises:
            SpoolError: The file cannot be read.
        """
        return [row[0] for row in self._rows("SELECT node FROM nodes ORDER BY node")]

    def certificate(self, thumbprint: bytes) -> NodeCertificate | None:
        """Read the certificate with a thumbprint.

        Raises:
            SpoolError: The file cannot be read.
        """
        rows = self._rows("SELECT * FROM certificates WHERE thumbprint = ?", thumbprint)
        return NodeCertificate(*rows[0]) if rows else None

    def description(self, node: str, name: bytes) -> bytes | None:
        """Read a description of a node by its hash; ``None`` if it is unknown or damaged.

        Raises:
            SpoolError: The file cannot be read.
        """
        rows = self._rows("SELECT body FROM descriptions WHERE node = ? AND hash = ?", node, name)
        if not rows:
            return None
        body: bytes = rows[0][0]
        if content_hash(body) != name:
            log.error("description damaged: path=%s node=%s", self._path, node)
            return None
        return body

    def description_sizes(self, node: str) -> dict[bytes, int]:
        """Hashes of all descriptions of a node with their sizes in bytes, oldest first.

        Raises:
            SpoolError: The file cannot be read.
        """
        query = "SELECT hash, length(body) FROM descriptions WHERE node = ? ORDER BY rowid"
        return dict(self._rows(query, node))

    def layouts_in_use(self, node: str) -> list[bytes]:
        """Hashes of the layouts that messages in the spool may name.

        Raises:
            SpoolError: The file cannot be read.
        """
        return [row[0] for row in self._rows(_SELECT_IN_USE, node)]

    def latest_layout(self, node: str) -> bytes | None:
        """Hash of the layout that a message of the node named last.

        Raises:
            SpoolError: The file cannot be read.
        """
        query = "SELECT hash FROM layouts WHERE node = ? ORDER BY last_message DESC LIMIT 1"
        rows = self._rows(query, node)
        return rows[0][0] if rows else None

    def dead_letters(self) -> list[DeadLetter]:
        """All dead letters, oldest first.

        Raises:
            SpoolError: The file cannot be read.
        """
        rows = self._rows("SELECT time, node, reason, body FROM dead_letters ORDER BY id")
        return [DeadLetter(*row) for row in rows]

    def oldest(self) -> int | None:
        """When the oldest message was received, UTC ns.

        Raises:
            SpoolError: The file cannot be read.
        """
        rows = self._rows("SELECT received FROM messages ORDER BY id LIMIT 1")
        return rows[0][0] if rows else None

    @property
    def statistics(self) -> SpoolStatistics:
        """Current state."""
        with self._lock:
            return SpoolStatistics(
                self._messages,
                self._used,
                self._capacity,
                self._dead_letters,
                self._dead_letters_dropped,
            )

    def _rows(self, query: str, *values: object) -> list[Any]:
        try:
            with self._lock:
                return self._ingest.execute(query, values).fetchall()
        except UNREADABLE as error:
            raise SpoolError(f"spool {self._path} cannot be read: {why(error)}") from error

    def _delete(
        self,
        messages: Sequence[SpoolMessage],
        dead_letters: Sequence[DeadLetter],
        confirmed: Sequence[SpoolMessage],
    ) -> tuple[int, int]:
        last: dict[tuple[str, int], int] = {}
        for message in confirmed:
            if message.boot is not None and message.sequence is not None:
                key = message.node, message.boot
                last[key] = max(message.sequence, last.get(key, 0))
        with self._transaction(self._forward) as connection:
            connection.executemany(_CONFIRM, [(*key, sequence) for key, sequence in last.items()])
            ids = SequenceRanges((message.id, message.id) for message in messages)
            connection.executemany(_DELETE_MESSAGES, ids)
            return self._insert_dead_letters(connection, dead_letters)

    def _regain_reserve(self) -> None:
        """Checkpoint, which frees the log's space, and reserve the space again."""
        try:
            self._forward.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        except sqlite3.Error as error:
            log.warning("checkpoint failed: path=%s error=%s", self._path, error)
        if self._reserve.hold():
            log.info("reserve regained: path=%s", self._path)

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

    def _insert_dead_letters(
        self, connection: sqlite3.Connection, dead_letters: Sequence[DeadLetter]
    ) -> tuple[int, int]:
        """Insert each content once; return how many were inserted and how many dropped."""
        if not dead_letters:
            return 0, 0
        rows = [
            (*letter[:4], letter.fingerprint or hashlib.sha256(letter.body).digest())
            for letter in dead_letters
        ]
        inserted = connection.executemany(_INSERT_DEAD_LETTER, rows).rowcount
        surplus = self._dead_letters + inserted - self._max_dead_letters
        if surplus <= 0:
            return inserted, 0
        return inserted, connection.execute(_DELETE_DEAD_LETTERS, (surplus,)).rowcount

    def _count_dead_letters(self, inserted: int, dropped: int) -> None:
        self._dead_letters += inserted - dropped
        self._dead_letters_dropped += dropped


def _write_descriptions(connection: sqlite3.Connection, batch: Batch) -> None:
    connection.executemany(_DELETE_DESCRIPTION, batch.evicted)
    connection.executemany(_DELETE_LAYOUT, batch.evicted)
    connection.executemany(_REPLACE_DESCRIPTION, batch.descriptions)
    if batch.layouts:
        (last,) = connection.execute("SELECT max(id) FROM messages").fetchone()
        connection.executemany(_REPLACE_LAYOUT, [(*used, last) for used in batch.layouts])


def _row(name: str, state: NodeState) -> tuple[object, ...]:
    held, ranges = state.held, state.encode_ranges()
    values = name, held.boot, held.sequence, ranges, state.status, state.thumbprint
    return *values, row_checksum(values)
