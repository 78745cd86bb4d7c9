"""Flash encryption: a node's records on its chip, each sealed for its own place.

In the clear stand position, priority, kind, how many samples and messages a record stands for, its
size, and the whole minutes that enclose its time. Of these, position and kind are authenticated;
the others are read only where a record does not open, to report what was lost.
"""

from __future__ import annotations

import itertools
import os
from functools import lru_cache, partial
from struct import Struct
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from cryptography.exceptions import InvalidTag

from eskin.errors import FlashError
from eskin.privacy.derivation import derive, nonce
from eskin.privacy.sealed_message import SALT_BYTES, whole_minutes
from eskin.wire.frames import Gap, Statements
from eskin.wire.messages import Position as Place
from eskin.wire.messages.cbor_map import MOST_COUNT
from eskin.wire.timestamp import MOST_INSTANT
from eskin_sensor_node.firmware.chip import StoredMessage
from eskin_sensor_node.firmware.message_writer import STATEMENTS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from cryptography.hazmat.primitives.ciphers.aead import AESGCM

    from eskin_sensor_node.firmware.chip import Position
    from eskin_sensor_node.firmware.message_writer import Record


ANSWER: Final = "answer"
UNREADABLE: Final = "flash record unreadable"
"""The reason in a gap."""
_EXACT: Final = Struct("<qqqq")
"""Earliest and latest instant, samples, and what it stands for: before the body, sealed."""
_NONCE_BYTES: Final = 12
_HEAD: Final = SALT_BYTES + _NONCE_BYTES
_KEPT: Final = 256
_PURPOSE: Final = b"eskin flash 1"


class Cipher:
    """Flash encryption, as a microcontroller has it between the firmware and its storage chip.

    AES-256-GCM; one for each opening of a flash, whose nonces it counts.

    Args:
        key: The chip's own.
    """

    def __init__(self, key: bytes) -> None:
        self._salt = os.urandom(SALT_BYTES)
        self._numbers = itertools.count()
        self._find = lru_cache(_KEPT)(partial(_derive, key))

    def seal(self, place: bytes, plaintext: bytes) -> bytes:
        """Salt, nonce, ciphertext and tag; only the same place opens them again."""
        counted = nonce(next(self._numbers))
        return self._salt + counted + self._find(self._salt).encrypt(counted, plaintext, place)

    def open(self, place: bytes, sealed: bytes) -> bytes | None:
        """Read what was sealed.

        Returns:
            The plaintext; ``None`` if another key sealed it, or for another place, or if it was
            changed.
        """
        if type(sealed) is not bytes:  # a damaged file may give anything
            return None
        aead = self._find(sealed[:SALT_BYTES])
        try:
            return aead.decrypt(sealed[SALT_BYTES:_HEAD], sealed[_HEAD:], place)
        except (InvalidTag, ValueError):
            return None


def _derive(key: bytes, salt: bytes) -> AESGCM:
    return derive(key, salt, _PURPOSE)


class Row(NamedTuple):
    """A record in its table.

    Attributes:
        boot: Of the node.
        sequence: In that boot.
        kind: As in `eskin_sensor_node.firmware.message_writer`.
        body: Sealed.
        earliest: UTC ns, a whole minute.
        latest: Likewise, behind it.
        samples: That go with it.
        stands_for: Messages: itself, and those that a gap names.
    """

    boot: int
    sequence: int
    kind: int
    body: bytes
    earliest: int
    latest: int
    samples: int
    stands_for: int


def read_row(values: Sequence[Any], path: Path) -> Row:
    """A record as a file gives it.

    Raises:
        FlashError: It is of other types than were ever written: the file's schema is damaged.
    """
    row = Row(*values)
    numbers = *row[:3], *row[4:]
    if type(row.body) is not bytes or any(type(number) is not int for number in numbers):
        raise FlashError(
            f"{path}: flash is damaged: a record is of other types than were written; bring back a "
            "copy, or remove the file with all that waits in it"
        )
    return row


class Sealing:
    """Seals and opens the records of one node.

    Args:
        cipher: The chip's.
        node: Whose it is.
    """

    __slots__ = ("_cipher", "_node")

    def __init__(self, cipher: Cipher, node: str) -> None:
        self._cipher = cipher
        self._node = node.encode()

    def __str__(self) -> str:
        return self._node.decode()

    def seal(self, kept: StoredMessage) -> Row:
        """Seal a stored message."""
        plaintext = _EXACT.pack(*kept.time, kept.samples, kept.messages) + kept.body
        body = self._cipher.seal(self._place(kept.position, kept.kind), plaintext)
        clear = *whole_minutes(kept.time), kept.samples, kept.messages
        return Row(*kept.position, kept.kind, body, *clear)

    def row(self, boot: int, record: Record) -> Row:
        """Seal a new message."""
        time = record.earliest, record.latest
        place = boot, record.sequence
        return self.seal(
            StoredMessage(place, record.kind, record.body, time, record.samples, 1 + record.named)
        )

    def open(self, row: Row) -> StoredMessage | None:
        """Open a record; ``None`` where it is damaged."""
        position = row.boot, row.sequence
        plaintext = self._cipher.open(self._place(position, row.kind), row.body)
        if plaintext is None:
            return None
        earliest, latest, samples, stands_for = _EXACT.unpack_from(plaintext)
        body = plaintext[_EXACT.size :]
        return StoredMessage(position, row.kind, body, (earliest, latest), samples, stands_for)

    def seal_last(self, what: str, body: bytes) -> bytes:
        """Seal what a node stores one of, such as its last ``answer``."""
        return self._cipher.seal(b"%b %b" % (self._node, what.encode()), body)

    def open_last(self, what: str, sealed: bytes) -> bytes | None:
        """Open that; ``None`` where it is damaged."""
        return self._cipher.open(b"%b %b" % (self._node, what.encode()), sealed)

    def open_answer(self, sealed: bytes, path: Path) -> bytes:
        """The last result; without it, commands might be done twice.

        Raises:
            FlashError: It is damaged.
        """
        body = self.open_last(ANSWER, sealed)
        if body is None:
            raise FlashError(
                f"{path}: flash is damaged: the last result of {self} does not open, so that it "
                "takes no command; bring back a copy, or remove the file with all that waits in it"
            )
        return body

    def _place(self, position: Position, kind: int) -> bytes:
        return b"%b message %d %d %d" % (self._node, *position, kind)


def lost_record_gap(row: Row, layout: bytes) -> StoredMessage:
    """The gap that replaces a record which does not open.

    It takes the record's number, so that the node's order does not change, and stands for as many
    messages. It reports the clear columns as far as a gap can.

    Args:
        row: The record.
        layout: Hash of the node's layout, by which statements are read.
    """
    position = row.boot, row.sequence
    earliest, latest = (max(-MOST_INSTANT, min(each, MOST_INSTANT)) for each in row[4:6])
    samples, messages = (max(0, min(each, MOST_COUNT)) for each in row[6:8])
    time = min(earliest, latest), max(earliest, latest)
    gap = Gap(UNREADABLE, time, messages, samples, ((row.boot, row.sequence, row.sequence),))
    body = Statements(Place(*position), layout, gaps=(gap,)).encode()
    return StoredMessage(position, STATEMENTS, body, time, samples, messages)
