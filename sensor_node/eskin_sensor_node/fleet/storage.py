"""The flash of a fleet: one file, a partition for each node, one synchronised commit for many.

What is told of the skin is sealed before it reaches the file (`machine.flash.sealing`).
"""

from __future__ import annotations

import logging
import time
from contextlib import ExitStack, closing, contextmanager
from typing import TYPE_CHECKING, Any, Final

from eskin.errors import FlashError, LockedError
from eskin.runtime.files.lock import LockFile
from eskin.runtime.sqlite_integrity import UNREADABLE, require_whole, why
from eskin_sensor_node.fleet.schema import RECORDS, SCHEMA, SEAL, teach
from eskin_sensor_node.machine.flash.cipher import Cipher
from eskin_sensor_node.machine.flash.flash import MOST_ENDED, end, sound_ends
from eskin_sensor_node.machine.flash.key_check import require_key
from eskin_sensor_node.machine.flash.migration import connect, migrate
from eskin_sensor_node.machine.flash.sealing import ANSWER, Row, Sealing, epitaph, read_row

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from eskin_sensor_node.firmware.chip import Position, StoredMessage
    from eskin_sensor_node.firmware.message_writer import Record

log = logging.getLogger(__name__)

_SELECT: Final = (
    "SELECT boot, sequence, kind, body, earliest, latest, samples, stands_for FROM message "
)
_TRIM: Final = """DELETE FROM ended WHERE ? < (SELECT count(*) FROM ended AS later
    WHERE later.member = ended.member AND later.boot >= ended.boot)"""
_GIVE_UP: Final = (
    "UPDATE message SET kind = ?, body = ? WHERE member = ? AND boot = ? AND sequence = ?"
)


class Storage:
    """The file. Opening counts the boots of all members, durably. For one thread.

    Args:
        path: Database file; made if missing.
        names: The members'.
        key: The chip's, under which all is sealed.
        epoch: Least number of this start; ``None`` takes the present in seconds, as `Flash` does.

    Raises:
        FlashError: It cannot be opened; or, by any method here or of a partition, it cannot be read
            or written.
    """

    def __init__(
        self, path: Path, names: Sequence[str], *, key: bytes, epoch: int | None = None
    ) -> None:
        self.path = path
        self._cipher = Cipher(key)
        least = int(time.time()) if epoch is None else epoch
        try:
            with ExitStack() as opened:
                self._owner = opened.enter_context(LockFile(path))
                self.db = opened.enter_context(closing(connect(path)))
                self._migrate()
                self.db.execute("BEGIN IMMEDIATE")
                self.db.executemany(
                    "INSERT INTO member (name, boot) VALUES (?, ?) "
                    "ON CONFLICT (name) DO UPDATE SET boot = max(boot + 1, excluded.boot)",
                    ((name, least) for name in names),
                )
                self.db.execute(_TRIM, (MOST_ENDED,))
                self.db.execute("COMMIT")
                opened.pop_all()
        except LockedError as error:
            raise FlashError(f"{path}: another fleet runs on this flash; stop it first") from error
        except (OSError, *UNREADABLE) as error:
            raise FlashError(
                f"{path}: flash cannot be opened: {why(error)}; check folder, rights and free space"
            ) from error
        rows = self.query("SELECT name, id, boot FROM member")
        self._members = {name: (number, boot) for name, number, boot in rows}

    def partition(self, name: str) -> Partition:
        """One member's part."""
        return Partition(self, *self._members[name], Sealing(self._cipher, name))

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
        except UNREADABLE as error:
            raise FlashError(f"{self.path}: flash cannot be read: {why(error)}") from error

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Say what went wrong in our words."""
        try:
            yield
        except UNREADABLE as error:
            raise FlashError(
                f"{self.path}: flash cannot be written: {why(error)}; make room, sampling "
                "goes on and gaps will tell"
            ) from error

    def close(self) -> None:
        """Close the file."""
        self.db.close()
        self._owner.close()

    def _migrate(self) -> None:
        require_whole(self.db)
        teach(self.db, self._cipher)
        migrate(self.db, self.path, schema=SCHEMA, seal=SEAL)
        require_key(self.db, self.path, Sealing(self._cipher, ""), self._records())

    def _records(self) -> Iterator[tuple[Sealing, Row]]:
        for name, *row in self.db.execute(RECORDS):
            yield Sealing(self._cipher, name), read_row(row, self.path)


class Partition:
    """A member's chip; its transactions are part of one for many where the storage has begun one.

    Attributes:
        boot: Number of this start.
    """

    __slots__ = (
        "_member", "_part", "_sealing", "_storage", "_uncounted", "_unreadable", "boot",
    )  # fmt: skip

    def __init__(self, storage: Storage, member: int, boot: int, sealing: Sealing) -> None:
        self._storage = storage
        self._sealing = sealing
        self._member = member
        self._unreadable = 0
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
        row = self._sealing.row(boot, record)
        with self._storage.writing():
            self._storage.db.execute(
                "INSERT OR REPLACE INTO message VALUES (?,?,?,?,?,?,?,?,?,?,?)",
                (self._member, *row[:2], shelf, *row[4:], row.kind, row.body, len(record.body)),
            )

    def delete(self, boot: int, first: int, last: int) -> tuple[int, int]:
        """Delete from the first to the last sequence; gives how many, and their bytes."""
        with self._storage.writing():
            rows = self._storage.db.execute(
                "DELETE FROM message WHERE member = ? AND boot = ? AND sequence BETWEEN ? AND ? "
                "RETURNING size",
                (self._member, boot, first, last),
            ).fetchall()
        return len(rows), sum(row[0] for row in rows)

    def read(self, position: Position) -> StoredMessage | None:
        """One message; ``None`` if it is gone."""
        found = self._select("AND boot = ? AND sequence = ?", *position)
        return found[0] if found else None

    def after(self, position: Position, limit: int) -> list[StoredMessage]:
        """The next messages behind a position, in order."""
        condition = "AND (boot, sequence) > (?, ?) ORDER BY boot, sequence LIMIT ?"
        return self._select(condition, *position, limit)

    def oldest(self, shelf: int) -> StoredMessage | None:
        """The first message of a shelf."""
        found = self._select("AND shelf = ? ORDER BY boot, sequence LIMIT 1", shelf)
        return found[0] if found else None

    def level(self) -> tuple[int, int]:
        """How many messages it keeps, and their bytes."""
        rows = self._storage.query(
            "SELECT count(*), coalesce(sum(size), 0) FROM message WHERE member = ?",
            self._member,
        )
        return rows[0][0], rows[0][1]

    def gaps(self) -> int:
        """How many gaps were ever recorded, with those in the place of unreadable records."""
        rows = self._storage.query(
            "SELECT gaps, coalesce(records, 0) FROM member LEFT JOIN unreadable ON member = id "
            "WHERE id = ?",
            self._member,
        )
        gaps, self._unreadable = rows[0]
        return int(gaps) + self._unreadable

    def keep_counts(self, gaps: int, last: int) -> None:
        """Keep that number, and the boot's last; gaps since it was asked are counted here."""
        with self._storage.writing():
            self._storage.db.execute(
                "UPDATE member SET gaps = ?1 WHERE id = ?2 AND gaps <> ?1",
                (gaps - self._unreadable, self._member),
            )
            self._storage.db.execute(
                "INSERT OR REPLACE INTO ended VALUES (?, ?, ?, ?)",
                (self._member, *end(self.boot, last)),
            )

    def ended(self) -> list[Position]:
        """The latest former boots that kept a message, and the last number of each, in order."""
        rows = self._storage.query(
            "SELECT boot, last, digest FROM ended WHERE member = ? ORDER BY boot", self._member
        )
        return sound_ends(rows, self._storage.path, before=self.boot)

    def answer(self) -> bytes | None:
        """The last result, also after it was acknowledged."""
        rows = self._storage.query("SELECT body FROM answer WHERE member = ?", self._member)
        return self._sealing.open_answer(rows[0][0], self._storage.path) if rows else None

    def keep_answer(self, body: bytes) -> None:
        """Keep the last result apart from the messages."""
        sealed = self._sealing.seal_last(ANSWER, body)
        with self._storage.writing():
            self._storage.db.execute(
                "INSERT OR REPLACE INTO answer VALUES (?, ?)", (self._member, sealed)
            )

    def charge(self) -> bytes:
        """Nothing: a fleet's supplies never end."""
        return b""

    def keep_charge(self, body: bytes) -> None:
        """There is nothing to keep."""

    def _select(self, condition: str, *values: int) -> list[StoredMessage]:
        statement = f"{_SELECT} WHERE member = ? {condition}"
        found = self._storage.query(statement, self._member, *values)
        rows = [read_row(row, self._storage.path) for row in found]
        return [self._sealing.open(row) or self._give_up(row) for row in rows]

    def _give_up(self, row: Row) -> StoredMessage:
        """Tell a record that does not open as lost, by a gap in its place."""
        gap = epitaph(row)
        body = self._sealing.seal(gap).body
        with self._storage.writing():
            self._storage.db.execute(_GIVE_UP, (gap.kind, body, self._member, *gap.position))
        log.error("record lost: node=%s boot=%d sequence=%d", self._sealing, *gap.position)
        return gap
