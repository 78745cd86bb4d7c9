"""Ids and cursors that reveal no number of messages.

A cursor counts all messages, including sealed ones: a reader could count heartbeats. So cursors
leave the cloud encrypted, deterministically, under a key of the store.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from cachetools import FIFOCache
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESSIV
from sqlalchemy import select

from eskin_cloud.query.cursors import invalid_cursor
from eskin_cloud.store.feed_position import FeedPosition
from eskin_cloud.store.schema.tables import versions
from eskin_cloud.store.slot import SLOTS

if TYPE_CHECKING:
    from sqlalchemy import Connection

_NUMBER_BYTES: Final = 5
"""Of a number within a slot: a thousand messages a second for 34 years."""
_KEPT: Final = 512


class OpaqueIds:
    """Encrypts numbers by AES-SIV (RFC 5297): deterministic and authenticated.

    Args:
        key: 32 bytes.
    """

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._aead = AESSIV(key)
        self._positions: FIFOCache[FeedPosition, str] = FIFOCache(_KEPT)

    @classmethod
    def of(cls, connection: Connection) -> Self:
        """Ids under a store's key, the same in all processes."""
        return cls(connection.execute(select(versions.c.cursor_key)).scalar_one())

    def write(self, *numbers: int) -> str:
        """Encrypt numbers."""
        return self._encrypt(",".join(map(str, numbers)).encode())

    def read(self, text: str, count: int) -> list[int]:
        """Decrypt numbers.

        Raises:
            QueryError: The text was not encrypted here, or holds another count.
        """
        try:
            numbers = [int(part) for part in self._decrypt(text).split(b",")]
        except ValueError as error:
            raise invalid_cursor() from error
        if len(numbers) != count:
            raise invalid_cursor()
        return numbers

    def write_position(self, position: FeedPosition) -> str:
        """Encrypt a position in the feed; the text has the same length for all positions."""
        text = self._positions.get(position)
        if text is None:
            numbers = np.array(position.cursors, np.uint64) // SLOTS
            octets = numbers.astype(">u8").view(np.uint8).reshape(SLOTS, 8)
            text = self._encrypt(octets[:, -_NUMBER_BYTES:].tobytes())
            self._positions[position] = text
        return text

    def read_position(self, text: str) -> FeedPosition:
        """Decrypt a position in the feed.

        Raises:
            QueryError: The text is no position that a cloud on this store encrypted.
        """
        data = self._decrypt(text)
        if len(data) != SLOTS * _NUMBER_BYTES:
            raise invalid_cursor()
        places = range(0, len(data), _NUMBER_BYTES)
        return FeedPosition.of(int.from_bytes(data[at : at + _NUMBER_BYTES]) for at in places)

    def _encrypt(self, data: bytes) -> str:
        return base64.urlsafe_b64encode(self._aead.encrypt(data, None)).decode().rstrip("=")

    def _decrypt(self, text: str) -> bytes:
        try:
            data = base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
            return self._aead.decrypt(data, None)
        except (InvalidTag, binascii.Error, ValueError) as error:
            raise invalid_cursor() from error

    def number(self, node: str, boot: int, sequence: int) -> int:
        """A 52-bit id of a message, which reveals no count."""
        name = f"{node} {boot} {sequence}".encode()
        digest = hashlib.blake2b(name, key=self._key, digest_size=8).digest()
        return int.from_bytes(digest, "big") >> 12
