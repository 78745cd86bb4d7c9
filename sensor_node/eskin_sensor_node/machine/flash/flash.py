"""A node's flash chip, emulated: messages in a file, each batch one synchronised commit.

Messages are encrypted before they reach the file (`machine.flash.sealing`).
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, Final

from eskin.errors import FlashError
from eskin.runtime.digest import row_checksum
from eskin_sensor_node.machine.flash.file import MOST_ENDED, FlashFile
from eskin_sensor_node.machine.flash.sealing import ANSWER, Row, lost_record_gap, read_row

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from eskin_sensor_node.firmware.chip import Position, StoredMessage
    from eskin_sensor_node.firmware.message_writer import Record

log = logging.getLogger(__name__)

_SELECT: Final = """SELECT boot, sequence, kind, body, earliest, latest, samples, stands_for
    FROM message WHERE member = ? """
_TRIM: Final = """DELETE FROM ended WHERE member = ?1 AND boot NOT IN
    (SELECT boot FROM ended WHERE member = ?1 ORDER BY boot DESC LIMIT ?2)"""
_GIVE_UP: Final = (
    "UPDATE message SET kind = ?, body = ? WHERE member = ? AND boot = ? AND sequence = ?"
)
_CHARGE: Final = "charge"
_FORGET: Final = "DELETE FROM description WHERE member = ? AND hash = ?"
_DESCRIBE: Final = """INSERT INTO description (member, hash, body) VALUES (?, ?, ?)
    ON CONFLICT (member, hash) DO UPDATE SET body = excluded.body"""


class Partition:
    """A member's chip; its transactions join the file's where one is open.

    Args:
        file: The file.
        name: The member's.

    Attributes:
        boot: Number of this boot.
        file: As given.

    Raises:
        FlashError: By any method: it cannot be read or written.
    """

    __slots__ = (
        *("_layout", "_member", "_name", "_nested", "_sealing", "_uncounted", "_unreadable"),
        *("boot", "file"),
    )

    def __init__(self, file: FlashFile, name: str) -> None:
        self.file = file
        self._name = name
        self._member, self.boot = file.members[name]
        self._sealing = file.sealing(name)
        self._layout = b""
        self._unreadable = 0
        self._nested = self._uncounted = False

    def restart(self) -> None:
        """Count another boot, durably; if that fails, the number stays as it was."""
        self.begin()
        try:
            self._count(self.boot + 1)
            self._write(_TRIM, self._member, MOST_ENDED)
            self.commit()
        except FlashError:
            self.roll_back()
            raise
        self.boot += 1

    def begin(self) -> None:
        """Begin a transaction, or a savepoint in the file's."""
        self._nested = self.file.db.in_transaction
        self._write("SAVEPOINT part" if self._nested else "BEGIN IMMEDIATE")
        if self._uncounted:
            self._count(self.boot)

    def commit(self) -> None:
        """Commit; a savepoint becomes durable with the file's transaction."""
        self._write("RELEASE part" if self._nested else "COMMIT")
        self._uncounted = False

    def roll_back(self) -> None:
        """Roll back, if a transaction is open."""
        if not self.file.db.in_transaction:
            return
        self._write("ROLLBACK TO part" if self._nested else "ROLLBACK")
        if self._nested:
            self._write("RELEASE part")

    def recount(self) -> None:
        """The file's transaction was rolled back: count the boot again in the next one."""
        self._uncounted = True

    def append(self, boot: int, record: Record, priority: int) -> None:
        """Store a message."""
        row = self._sealing.row(boot, record)
        self._write(
            "INSERT OR REPLACE INTO message VALUES (?,?,?,?,?,?,?,?,?,?,?)",
            *(self._member, *row[:2], priority, *row[4:], row.kind, row.body, len(record.body)),
        )

    def delete(self, boot: int, first: int, last: int) -> tuple[int, int]:
        """Delete from the first to the last sequence; gives how many, and their bytes."""
        rows = self._write(
            "DELETE FROM message WHERE member = ? AND boot = ? AND sequence BETWEEN ? AND ? "
            "RETURNING size",
            *(self._member, boot, first, last),
        )
        return len(rows), sum(row[0] for row in rows)

    def read(self, position: Position) -> StoredMessage | None:
        """One message; ``None`` if it is gone."""
        found = self._select("AND boot = ? AND sequence = ?", *position)
        return found[0] if found else None

    def after(self, position: Position, limit: int) -> list[StoredMessage]:
        """The next messages behind a position, in order."""
        condition = "AND (boot, sequence) > (?, ?) ORDER BY boot, sequence LIMIT ?"
        return self._select(condition, *position, limit)

    def oldest(self, priority: int) -> StoredMessage | None:
        """The first message of a priority."""
        found = self._select("AND priority = ? ORDER BY boot, sequence LIMIT 1", priority)
        return found[0] if found else None

    def level(self) -> tuple[int, int]:
        """How many messages it holds, and their bytes."""
        rows = self.file.query(
            "SELECT count(*), coalesce(sum(size), 0) FROM message WHERE member = ?", self._member
        )
        return rows[0][0], rows[0][1]

    def gaps(self) -> int:
        """How many gaps were ever recorded, with those in the place of unreadable records."""
        rows = self.file.query(
            "SELECT gaps, coalesce(records, 0) FROM member LEFT JOIN unreadable ON member = id "
            "WHERE id = ?",
            self._member,
        )
        if not rows:
            raise FlashError(f"{self.file.path}: flash is damaged: its count of gaps is gone")
        gaps, self._unreadable = rows[0]
        return int(gaps) + self._unreadable

    def store_counts(self, gaps: int, last: int) -> None:
        """Store that number, and the boot's last; gaps since `gaps` was read are counted here."""
        counted = gaps - self._unreadable
        self._write(
            "UPDATE member SET gaps = ?1, digest = ?3 WHERE id = ?2 AND gaps <> ?1",
            *(counted, self._member, row_checksum((self._name, counted))),
        )
        numbers = self.boot, last
        self._write(
            "INSERT OR REPLACE INTO ended VALUES (?, ?, ?, ?)",
            *(self._member, *numbers, row_checksum(numbers)),
        )

    def ended(self) -> list[Position]:
        """The latest former boots that stored a message, and the last number of each, in order."""
        rows = self.file.query(
            "SELECT boot, last, digest FROM ended WHERE member = ? ORDER BY boot", self._member
        )
        found = [row[:2] for row in rows if row[2] == row_checksum(row[:2])]
        if len(found) < len(rows):
            log.error("last number of a boot lost: path=%s cause=damaged", self.file.path)
        return [each for each in found if each[0] < self.boot][-MOST_ENDED:]

    def answer(self) -> bytes | None:
        """The last result, also after it was acknowledged."""
        rows = self.file.query("SELECT body FROM answer WHERE member = ?", self._member)
        return self._sealing.open_answer(rows[0][0], self.file.path) if rows else None

    def store_answer(self, body: bytes) -> None:
        """Store the last result apart from the messages."""
        sealed = self._sealing.seal_last(ANSWER, body)
        self._write("INSERT OR REPLACE INTO answer VALUES (?, ?)", self._member, sealed)

    def store_descriptions(self, layout: bytes, descriptions: Mapping[bytes, bytes]) -> None:
        """Store descriptions by their hashes; while no message waits, all others are deleted.

        Comes before messages are read: a record that does not open becomes a gap, which names the
        layout.

        What is stored already is not written again: a node also starts on a full disk.
        """
        kept = {name: self.description(name) for name in self.descriptions()}
        if kept == descriptions:
            self._layout = layout
            return
        self.begin()
        try:
            if not self.level()[0]:
                for name in self.descriptions():
                    if name not in descriptions:
                        self._write(_FORGET, self._member, name)
            for name, body in descriptions.items():
                if self.description(name) is None:
                    sealed = self._sealing.seal_last(_description(name), body)
                    self._write(_DESCRIBE, self._member, name, sealed)
            self.commit()
        except FlashError:
            self.roll_back()
            raise
        self._layout = layout

    def descriptions(self) -> list[bytes]:
        """The hashes of all descriptions, in the order of their first storing."""
        query = "SELECT hash FROM description WHERE member = ? ORDER BY id"
        rows = self.file.query(query, self._member)
        return [row[0] for row in rows if type(row[0]) is bytes]  # a damaged file may give anything

    def description(self, name: bytes) -> bytes | None:
        """The description of a hash; ``None`` where there is none, or where it does not open."""
        query = "SELECT body FROM description WHERE member = ? AND hash = ?"
        rows = self.file.query(query, self._member, name)
        if not rows:
            return None
        body = self._sealing.open_last(_description(name), rows[0][0])
        if body is None:
            log.error("description lost: path=%s cause=damaged", self.file.path)
        return body

    def charge(self) -> bytes:
        """What was stored of the supply; empty where nothing was, or where it does not open."""
        rows = self.file.query("SELECT body FROM charge WHERE member = ?", self._member)
        body = self._sealing.open_last(_CHARGE, rows[0][0]) if rows else b""
        if body is None:
            log.error("charge lost: path=%s cause=damaged", self.file.path)
        return body or b""

    def store_charge(self, body: bytes) -> None:
        """Store that."""
        sealed = self._sealing.seal_last(_CHARGE, body)
        self._write("INSERT OR REPLACE INTO charge VALUES (?, ?)", self._member, sealed)

    def _count(self, boot: int) -> None:
        self._write("UPDATE member SET boot = ? WHERE id = ?", boot, self._member)

    def _write(self, statement: str, *values: int | bytes) -> list[tuple[Any, ...]]:
        with self.file.writing():
            return self.file.db.execute(statement, values).fetchall()

    def _select(self, condition: str, *values: int) -> list[StoredMessage]:
        found = self.file.query(_SELECT + condition, self._member, *values)
        rows = [read_row(row, self.file.path) for row in found]
        return [self._sealing.open(row) or self._give_up(row) for row in rows]

    def _give_up(self, row: Row) -> StoredMessage:
        """Replace a record that does not open by a gap that names it.

        Raises:
            FlashError: The layout is not known yet, by which a gap is read.
        """
        if not self._layout:
            raise FlashError(
                f"{self.file.path}: a record of {self._sealing} does not open; store the node's "
                "descriptions before messages are read, as a gap needs its layout"
            )
        gap = lost_record_gap(row, self._layout)
        body = self._sealing.seal(gap).body
        self._write(_GIVE_UP, gap.kind, body, self._member, *gap.position)
        log.error("record lost: node=%s boot=%d sequence=%d", self._sealing, *gap.position)
        return gap


def _description(name: bytes) -> str:
    return f"description {name.hex()}"


class Flash(Partition):
    """The chip of a node that has a file of its own; the outbox's lock guards it.

    Args:
        path: Database file; created if missing.
        node: The node's name.
        key: As of `FlashFile`.
        epoch: As of `FlashFile`.

    Raises:
        FlashError: It cannot be opened.
    """

    def __init__(self, path: Path, *, node: str, key: bytes, epoch: int | None = None) -> None:
        super().__init__(FlashFile(path, [node], key=key, owner=node, epoch=epoch), node)

    def close(self) -> None:
        """Close the file."""
        self.file.close()
