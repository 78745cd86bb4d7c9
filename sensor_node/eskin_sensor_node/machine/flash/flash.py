"""A node's flash chip, emulated: messages in a file, each batch one synchronised commit.

What is told of the skin is sealed before it reaches the file (`machine.flash.sealing`).
"""

from __future__ import annotations

import logging
import time
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from eskin.errors import FlashError, LockedError
from eskin.runtime.digest import row_checksum
from eskin.runtime.files.lock import LockFile
from eskin.runtime.sqlite_integrity import UNREADABLE, require_whole, why
from eskin_sensor_node.machine.flash.cipher import Cipher
from eskin_sensor_node.machine.flash.key_check import PROOF, require_key
from eskin_sensor_node.machine.flash.migration import connect, migrate
from eskin_sensor_node.machine.flash.sealing import (
    ANSWER,
    Row,
    Sealing,
    epitaph,
    kept_in_clear,
    read_row,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from eskin_sensor_node.firmware.chip import Position, StoredMessage
    from eskin_sensor_node.firmware.message_writer import Record

log = logging.getLogger(__name__)

_SCHEMA: Final = (
    "CREATE TABLE IF NOT EXISTS counter (name TEXT PRIMARY KEY, value INTEGER NOT NULL) STRICT",
    "INSERT OR IGNORE INTO counter VALUES ('boot', 0), ('gaps', 0), ('unreadable', 0)",
    """CREATE TABLE IF NOT EXISTS message (
        boot INTEGER NOT NULL,
        sequence INTEGER NOT NULL,
        weight INTEGER NOT NULL,     -- the shelf that the outbox put it on
        earliest INTEGER NOT NULL,   -- UTC ns, whole minutes
        latest INTEGER NOT NULL,
        samples INTEGER NOT NULL,
        stands_for INTEGER NOT NULL, -- messages: itself, and those that a gap names
        kind INTEGER NOT NULL,
        body BLOB NOT NULL,          -- sealed
        size INTEGER NOT NULL,       -- bytes that the outbox counts
        PRIMARY KEY (boot, sequence)
    ) STRICT""",
    """CREATE TABLE IF NOT EXISTS answer ( -- the last result: by it no command is done twice
        one INTEGER PRIMARY KEY CHECK (one = 1),
        body BLOB NOT NULL
    ) STRICT""",
    """CREATE TABLE IF NOT EXISTS charge ( -- what the last life knew of its supply
        one INTEGER PRIMARY KEY CHECK (one = 1),
        body BLOB NOT NULL
    ) STRICT""",
    """CREATE TABLE IF NOT EXISTS ended ( -- the last number of each boot
        boot INTEGER PRIMARY KEY,
        last INTEGER NOT NULL,
        digest INTEGER NOT NULL      -- of both: the cloud counts what is missing by them
    ) STRICT""",
    PROOF,
    "CREATE INDEX IF NOT EXISTS message_weight ON message (weight, boot, sequence)",
    # Nothing else ever changes a record's kind.
    """CREATE TRIGGER IF NOT EXISTS gave_up AFTER UPDATE OF kind ON message BEGIN
        UPDATE counter SET value = value + 1 WHERE name = 'unreadable';
    END""",
)
_SEAL: Final = (
    "ALTER TABLE message ADD COLUMN size INTEGER NOT NULL DEFAULT 0",
    """UPDATE message SET size = length(body),
        body = sealed(boot, sequence, kind, body, earliest, latest, samples, stands_for),
        earliest = minute_before(earliest), latest = minute_behind(latest)""",
    "UPDATE answer SET body = sealed_last('answer', body)",
    "UPDATE charge SET body = sealed_last('charge', body)",
)
_COUNT: Final = "UPDATE counter SET value = max(value + 1, ?) WHERE name = 'boot'"
_TRIM: Final = """DELETE FROM ended WHERE boot NOT IN
    (SELECT boot FROM ended ORDER BY boot DESC LIMIT ?)"""
MOST_ENDED: Final = 8
"""Former boots whose last numbers are kept, and told with each status."""
_SELECT: Final = (
    "SELECT boot, sequence, kind, body, earliest, latest, samples, stands_for FROM message "
)
_CHARGE: Final = "charge"
_GIVE_UP: Final = "UPDATE message SET kind = ?, body = ? WHERE boot = ? AND sequence = ?"


def end(boot: int, last: int) -> tuple[int, int, int]:
    """A boot's last number as a row, with its digest."""
    return boot, last, row_checksum((boot, last))


def sound_ends(rows: Sequence[Sequence[Any]], path: Path, *, before: int) -> list[Position]:
    """The latest of what `end` gave, in order, before a boot; what is damaged is left out."""
    found = [(row[0], row[1]) for row in rows if row[2] == row_checksum(row[:2])]
    if len(found) < len(rows):
        log.error("flash is damaged, the last number of a boot is unknown: path=%s", path)
    return [each for each in found if each[0] < before][-MOST_ENDED:]


class Flash:
    """The chip on which a node's outbox keeps its messages; the outbox's lock guards it.

    Opening counts the boot, durably, before anyone can use its number.

    Args:
        path: Database file; made if missing.
        node: Whose it is.
        key: The chip's, under which all is sealed.
        epoch: Least number of this start; ``None`` takes the present in seconds, so that a flash
            that was wiped, or replaced by an older copy, starts above all numbers that the node has
            used before, which others remember.

    Attributes:
        boot: Number of this start.

    Raises:
        FlashError: It cannot be opened; or, by any method, it cannot be read or written.
    """

    def __init__(self, path: Path, *, node: str, key: bytes, epoch: int | None = None) -> None:
        self._path = path
        self._sealing = Sealing(Cipher(key), node)
        self._unreadable = 0
        try:
            with ExitStack() as opened:
                self._owner = opened.enter_context(LockFile(path))
                self._db = opened.enter_context(closing(connect(path)))
                self._migrate()
                self._db.execute(_COUNT, (int(time.time()) if epoch is None else epoch,))
                self.boot: int = self._counter("boot")
                self._db.execute(_TRIM, (MOST_ENDED,))
                opened.pop_all()
        except LockedError as error:
            raise FlashError(f"{path}: another node runs on this flash; stop it first") from error
        except (OSError, *UNREADABLE) as error:
            raise FlashError(
                f"{path}: flash cannot be opened: {why(error)}; check folder, rights and free space"
            ) from error

    def restart(self) -> None:
        """Count a boot of the machine, durably; if that fails, the number stays as it was."""
        with self._writing():
            self._db.execute(_COUNT, (self.boot + 1,))
            self.boot += 1
            self._db.execute(_TRIM, (MOST_ENDED,))

    def begin(self) -> None:
        """Begin a transaction."""
        with self._writing():
            self._db.execute("BEGIN IMMEDIATE")

    def commit(self) -> None:
        """End it; when this returns, it is on the disk."""
        with self._writing():
            self._db.execute("COMMIT")

    def roll_back(self) -> None:
        """Undo it, if one is open."""
        with self._writing():
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")

    def append(self, boot: int, record: Record, shelf: int) -> None:
        """Keep a message on a shelf."""
        row = self._sealing.row(boot, record)
        with self._writing():
            self._db.execute(
                "INSERT OR REPLACE INTO message VALUES (?,?,?,?,?,?,?,?,?,?)",
                (*row[:2], shelf, *row[4:], row.kind, row.body, len(record.body)),
            )

    def delete(self, boot: int, first: int, last: int) -> tuple[int, int]:
        """Delete from the first to the last sequence; gives how many, and their bytes."""
        with self._writing():
            rows = self._db.execute(
                "DELETE FROM message WHERE boot = ? AND sequence BETWEEN ? AND ? RETURNING size",
                (boot, first, last),
            ).fetchall()
        return len(rows), sum(row[0] for row in rows)

    def read(self, position: Position) -> StoredMessage | None:
        """One message; ``None`` if it is gone."""
        found = self._select("WHERE boot = ? AND sequence = ?", *position)
        return found[0] if found else None

    def after(self, position: Position, limit: int) -> list[StoredMessage]:
        """The next messages behind a position, in order."""
        return self._select(
            "WHERE (boot, sequence) > (?, ?) ORDER BY boot, sequence LIMIT ?", *position, limit
        )

    def oldest(self, shelf: int) -> StoredMessage | None:
        """The first message of a shelf."""
        found = self._select("WHERE weight = ? ORDER BY boot, sequence LIMIT 1", shelf)
        return found[0] if found else None

    def level(self) -> tuple[int, int]:
        """How many messages it keeps, and their bytes."""
        rows = self._query("SELECT count(*), coalesce(sum(size), 0) FROM message")
        return rows[0][0], rows[0][1]

    def gaps(self) -> int:
        """How many gaps were ever recorded, with those in the place of unreadable records."""
        self._unreadable = self._counter("unreadable")
        return self._counter("gaps") + self._unreadable

    def keep_counts(self, gaps: int, last: int) -> None:
        """Keep that number, and the boot's last; gaps since it was asked are counted here."""
        with self._writing():
            self._db.execute(
                "UPDATE counter SET value = ? WHERE name = 'gaps'", (gaps - self._unreadable,)
            )
            self._db.execute("INSERT OR REPLACE INTO ended VALUES (?, ?, ?)", end(self.boot, last))

    def ended(self) -> list[Position]:
        """The latest former boots that kept a message, and the last number of each, in order."""
        rows = self._query("SELECT boot, last, digest FROM ended ORDER BY boot")
        return sound_ends(rows, self._path, before=self.boot)

    def answer(self) -> bytes | None:
        """The last result, also after it was acknowledged."""
        rows = self._query("SELECT body FROM answer")
        return self._sealing.open_answer(rows[0][0], self._path) if rows else None

    def keep_answer(self, body: bytes) -> None:
        """Keep the last result apart from the messages."""
        sealed = self._sealing.seal_last(ANSWER, body)
        with self._writing():
            self._db.execute("INSERT OR REPLACE INTO answer VALUES (1, ?)", (sealed,))

    def charge(self) -> bytes:
        """What was kept of the supply; empty where nothing was, or where it does not open."""
        rows = self._query("SELECT body FROM charge")
        body = self._sealing.open_last(_CHARGE, rows[0][0]) if rows else b""
        if body is None:
            log.error("flash is damaged, the charge is unknown: path=%s", self._path)
        return body or b""

    def keep_charge(self, body: bytes) -> None:
        """Keep that."""
        sealed = self._sealing.seal_last(_CHARGE, body)
        with self._writing():
            self._db.execute("INSERT OR REPLACE INTO charge VALUES (1, ?)", (sealed,))

    def close(self) -> None:
        """Close the file."""
        self._db.close()
        self._owner.close()

    def _counter(self, name: str) -> int:
        rows = self._query("SELECT value FROM counter WHERE name = ?", name)
        if not rows:
            raise FlashError(f"{self._path}: flash is damaged: its counter {name} is gone")
        value: int = rows[0][0]
        return value

    def _migrate(self) -> None:
        require_whole(self._db)
        self._db.create_function("sealed", 8, partial(_sealed, self._sealing))
        self._db.create_function("sealed_last", 2, self._sealing.seal_last)
        migrate(self._db, self._path, schema=_SCHEMA, seal=_SEAL)
        require_key(self._db, self._path, self._sealing, self._records())

    def _records(self) -> Iterator[tuple[Sealing, Row]]:
        for row in self._db.execute(_SELECT):
            yield self._sealing, read_row(row, self._path)

    def _select(self, condition: str, *values: int) -> list[StoredMessage]:
        rows = [read_row(row, self._path) for row in self._query(_SELECT + condition, *values)]
        return [self._sealing.open(row) or self._give_up(row) for row in rows]

    def _give_up(self, row: Row) -> StoredMessage:
        """Tell a record that does not open as lost, by a gap in its place."""
        gap = epitaph(row)
        body = self._sealing.seal(gap).body
        with self._writing():
            self._db.execute(_GIVE_UP, (gap.kind, body, *gap.position))
        log.error("record lost: node=%s boot=%d sequence=%d", self._sealing, *gap.position)
        return gap

    def _query(self, statement: str, *values: int | str) -> list[tuple[Any, ...]]:
        try:
            return self._db.execute(statement, values).fetchall()
        except UNREADABLE as error:
            raise FlashError(f"{self._path}: flash cannot be read: {why(error)}") from error

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except UNREADABLE as error:
            raise FlashError(
                f"{self._path}: flash cannot be written: {why(error)}; make room, sampling "
                "goes on and a gap will tell"
            ) from error


def _sealed(sealing: Sealing, *row: Any) -> bytes:
    """What lay in the clear."""
    return sealing.seal(kept_in_clear(*row)).body
