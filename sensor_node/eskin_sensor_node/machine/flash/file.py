"""The file of a flash chip: tables, format, key, and transactions that are synchronised to disk.

A node's file holds one member; a fleet's holds one for each node, so that one commit serves many.
"""

from __future__ import annotations

import logging
import sqlite3
import time
from contextlib import ExitStack, closing, contextmanager
from typing import TYPE_CHECKING, Any, Final

from eskin.errors import FlashError, LockedError
from eskin.runtime.digest import row_checksum
from eskin.runtime.files.lock import LockFile
from eskin.runtime.sqlite_integrity import UNREADABLE, require_whole, why
from eskin_sensor_node.machine.flash.sealing import Cipher, Sealing, read_row

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

log = logging.getLogger(__name__)

_VERSION: Final = 1
"""Of the format, as ``user_version``."""
_SCHEMA: Final = (
    """CREATE TABLE IF NOT EXISTS member (
        id INTEGER PRIMARY KEY,
        name TEXT NOT NULL UNIQUE,
        boot INTEGER NOT NULL,
        gaps INTEGER NOT NULL DEFAULT 0,
        digest INTEGER NOT NULL      -- of name and gaps
    ) STRICT""",
    """CREATE TABLE IF NOT EXISTS message (
        member INTEGER NOT NULL,
        boot INTEGER NOT NULL,
        sequence INTEGER NOT NULL,
        priority INTEGER NOT NULL,   -- in which order the outbox evicts
        earliest INTEGER NOT NULL,   -- UTC ns, whole minutes
        latest INTEGER NOT NULL,
        samples INTEGER NOT NULL,
        stands_for INTEGER NOT NULL, -- messages: itself, and those that a gap names
        kind INTEGER NOT NULL,
        body BLOB NOT NULL,          -- sealed
        size INTEGER NOT NULL,       -- bytes that the outbox counts
        PRIMARY KEY (member, boot, sequence)
    ) STRICT""",
    """CREATE TABLE IF NOT EXISTS answer ( -- the last result: by it no command is done twice
        member INTEGER PRIMARY KEY,
        body BLOB NOT NULL
    ) STRICT""",
    """CREATE TABLE IF NOT EXISTS charge ( -- what the last boot knew of its supply
        member INTEGER PRIMARY KEY,
        body BLOB NOT NULL
    ) STRICT""",
    """CREATE TABLE IF NOT EXISTS description ( -- layouts and patches, by which frames are read
        id INTEGER PRIMARY KEY,      -- in the order of their first keeping
        member INTEGER NOT NULL,
        hash BLOB NOT NULL,
        body BLOB NOT NULL,          -- sealed
        UNIQUE (member, hash)
    ) STRICT""",
    """CREATE TABLE IF NOT EXISTS unreadable ( -- records that could not be decrypted
        member INTEGER PRIMARY KEY,
        records INTEGER NOT NULL
    ) STRICT""",
    """CREATE TABLE IF NOT EXISTS ended ( -- the last number of each boot
        member INTEGER NOT NULL,
        boot INTEGER NOT NULL,
        last INTEGER NOT NULL,
        digest INTEGER NOT NULL,     -- of both: the cloud counts what is missing by them
        PRIMARY KEY (member, boot)
    ) STRICT, WITHOUT ROWID""",
    """CREATE TABLE IF NOT EXISTS key_check ( -- only the right key decrypts it
        one INTEGER PRIMARY KEY CHECK (one = 1),
        body BLOB NOT NULL
    ) STRICT""",
    """CREATE INDEX IF NOT EXISTS message_priority
        ON message (member, priority, boot, sequence)""",
    # Nothing else ever changes a record's kind.
    """CREATE TRIGGER IF NOT EXISTS gave_up AFTER UPDATE OF kind ON message BEGIN
        INSERT INTO unreadable VALUES (new.member, 1)
        ON CONFLICT (member) DO UPDATE SET records = records + 1;
    END""",
)
_COUNT: Final = """INSERT INTO member (name, boot, digest) VALUES (?, ?, ?)
    ON CONFLICT (name) DO UPDATE SET boot = max(boot + 1, excluded.boot)"""
_TRIM: Final = """DELETE FROM ended WHERE ? < (SELECT count(*) FROM ended AS later
    WHERE later.member = ended.member AND later.boot >= ended.boot)"""
_RECORDS: Final = """SELECT name, message.boot, sequence, kind, body, earliest, latest, samples,
    stands_for FROM message JOIN member ON id = member"""
_BY_MEMBER: Final = ("message", "answer", "charge", "description", "unreadable", "ended")
_KEY_CHECK: Final = "key_check"
_BUSY_TIMEOUT_MS: Final = 5000
MOST_ENDED: Final = 8
"""Former boots whose last numbers are kept; each status reports them."""


class FlashFile:
    """The file. Opening counts a boot of each member, durably, before its number can be used.

    Args:
        path: Database file; created if missing.
        names: The members'.
        key: The chip's, which encrypts all of it.
        owner: The node that alone uses the file; of a fleet, empty.
        epoch: Least number of this boot; ``None`` takes the present in seconds, so that a flash
            that was wiped, or replaced by an older copy, starts above all numbers that the node
            has used before.

    Attributes:
        path: As given.
        db: The connection, in autocommit mode.
        members: Row number and boot of each member, by name.

    Raises:
        FlashError: It cannot be opened; or, by any method here or of a partition, it cannot be read
            or written.
    """

    def __init__(
        self,
        path: Path,
        names: Sequence[str],
        *,
        key: bytes,
        owner: str = "",
        epoch: int | None = None,
    ) -> None:
        self.path = path
        self._cipher = Cipher(key)
        least = int(time.time()) if epoch is None else epoch
        try:
            with ExitStack() as opened:
                self._lock = opened.enter_context(LockFile(path))
                self.db = opened.enter_context(closing(_connect(path)))
                require_whole(self.db)
                self._create_tables()
                self._require_key(owner, set(names))
                self._require_members()
                self.db.execute("BEGIN IMMEDIATE")
                added = ((name, least, row_checksum((name, 0))) for name in names)
                self.db.executemany(_COUNT, added)
                self.db.execute(_TRIM, (MOST_ENDED,))
                self.db.execute("COMMIT")
                rows = self.query("SELECT name, id, boot FROM member")
                self.members: dict[str, tuple[int, int]] = {
                    name: (number, boot) for name, number, boot in rows
                }
                if not self.members.keys() >= set(names):
                    raise FlashError(f"{path}: flash is damaged: it does not count boots")
                self._report_orphans({owner} if owner else set(self.members))
                opened.pop_all()
        except LockedError as error:
            raise FlashError(
                f"{path}: another process runs on this flash; stop it first"
            ) from error
        except (OSError, *UNREADABLE) as error:
            raise FlashError(
                f"{path}: flash cannot be opened: {why(error)}; check folder, rights and free space"
            ) from error

    def sealing(self, name: str) -> Sealing:
        """Encrypts and decrypts a member's records."""
        return Sealing(self._cipher, name)

    @contextmanager
    def commit(self) -> Iterator[None]:
        """Commit what partitions write inside of the block at its end, all or nothing."""
        with self.writing():
            self.db.execute("BEGIN IMMEDIATE")
        try:
            yield
            with self.writing():
                self.db.execute("COMMIT")
        finally:
            if self.db.in_transaction:
                self.db.execute("ROLLBACK")

    def query(self, statement: str, *values: int | bytes) -> list[tuple[Any, ...]]:
        """Rows of a SELECT."""
        try:
            return self.db.execute(statement, values).fetchall()
        except UNREADABLE as error:
            raise FlashError(f"{self.path}: flash cannot be read: {why(error)}") from error

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Turn the database's errors into `FlashError`."""
        try:
            yield
        except UNREADABLE as error:
            raise FlashError(
                f"{self.path}: flash cannot be written: {why(error)}; make room, sampling "
                "continues and gaps report the loss"
            ) from error

    def close(self) -> None:
        """Close the file."""
        self.db.close()
        self._lock.close()

    def _create_tables(self) -> None:
        version: int = self.db.execute("PRAGMA user_version").fetchone()[0]
        if version not in {0, _VERSION}:
            raise FlashError(
                f"{self.path}: flash has format {version}, this node reads {_VERSION}; choose "
                "another flash.path"
            )
        self.db.execute("BEGIN IMMEDIATE")
        for statement in _SCHEMA:
            self.db.execute(statement)
        self.db.execute(f"PRAGMA user_version = {_VERSION}")
        self.db.execute("COMMIT")

    def _report_orphans(self, known: set[str]) -> None:
        """Find rows of no member, and members of no node: a flipped bit in a key hides them.

        Raises:
            FlashError: A last result is among them; without it a command could be done twice.
        """
        if unknown := self.members.keys() - known:
            raise FlashError(
                f"{self.path}: flash is damaged: it holds records of {sorted(unknown)}; erase it, "
                "the cloud names what is lost"
            )
        for table in _BY_MEMBER:
            orphans = f"SELECT count(*) FROM {table} WHERE member NOT IN (SELECT id FROM member)"  # noqa: S608 - our own names
            if count := self.db.execute(orphans).fetchone()[0]:
                if table == "answer":
                    raise FlashError(
                        f"{self.path}: flash is damaged: the last result has no owner; erase it, "
                        "the cloud names what is lost"
                    )
                log.error("flash is damaged: path=%s table=%s orphans=%d", self.path, table, count)

    def _require_members(self) -> None:
        """Verify the members' digests: under a damaged name, all records would be another node's.

        Raises:
            FlashError: One is damaged.
        """
        for name, gaps, digest in self.query("SELECT name, gaps, digest FROM member"):
            if digest != row_checksum((name, gaps)):
                raise FlashError(
                    f"{self.path}: flash is damaged: the node of some records is unknown, perhaps "
                    f"{name!r}; erase it, the cloud names what is lost"
                )

    def _require_key(self, owner: str, names: set[str]) -> None:
        """Check that key and owner are those of the file.

        Where the row of the check is missing or damaged, a record that opens is proof as well.
        """
        own = self.sealing(owner)
        check = self.db.execute("SELECT body FROM key_check").fetchone()
        if check is not None and own.open_last(_KEY_CHECK, check[0]) is not None:
            return
        encrypted = check is not None
        for name, *row in self.db.execute(_RECORDS):
            encrypted = True
            record = read_row(row, self.path)
            if name in names and self.sealing(name).open(record) is not None:
                break
        else:
            if encrypted:
                raise FlashError(
                    f"{self.path}: flash is sealed under another key, or for another node; bring "
                    "back the key store of keys.directory, or choose another flash.path"
                )
        body = own.seal_last(_KEY_CHECK, b"")
        self.db.execute("INSERT OR REPLACE INTO key_check VALUES (1, ?)", (body,))


def _connect(path: Path) -> sqlite3.Connection:
    db = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    db.execute(f"PRAGMA busy_timeout = {_BUSY_TIMEOUT_MS}")
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("PRAGMA synchronous = FULL")
    return db
