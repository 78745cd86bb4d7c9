"""Ids and cursors that reveal no number of messages.

A cursor counts all messages, including sealed ones: a reader could count heartbeats. So cursors
leave the cloud encrypted, deterministically, under a key of the store. All clouds on the store have
it, and no other store does, so a cursor of another store is rejected.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
from typing import Final

import numpy as np
from cachetools import FIFOCache
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESSIV

from eskin.errors import QueryError
from eskin.wire.slot import SLOTS
from eskin_cloud.store.feed_entry import FeedPosition

_NUMBER_BYTES: Final = 5
"""Of a number within a slot: a thousand messages a second for 34 years."""
_KEPT: Final = 512
_NUMBERS: Final = b"numbers"
_NAME: Final = b"name"
_POSITION: Final = b"position"
"""What a text holds: associated data, so that none is read as another kind."""


class UnknownCursorError(QueryError):
    """A cursor or id that no cloud on this store has issued, or for something else.

    Args:
        parameter: Name of the parameter that holds it.
        remedy: What the client does instead.
    """

    def __init__(
        self,
        parameter: str = "cursor",
        remedy: str = "pass the `next` of an earlier answer, or leave it out",
    ) -> None:
        super().__init__(parameter, f"was not issued here by a cloud on this store; {remedy}")


class OpaqueIds:
    """Encrypts numbers by AES-SIV (RFC 5297): deterministic and authenticated.

    Args:
        key: The store's, 32 bytes (`Store.cursor_key`).
    """

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._aead = AESSIV(key)
        self._positions: FIFOCache[FeedPosition, str] = FIFOCache(_KEPT)

    def write(self, *numbers: int) -> str:
        """Encrypt numbers."""
        return self._encrypt(_NUMBERS, ",".join(map(str, numbers)).encode())

    def read(self, text: str, count: int) -> list[int]:
        """Decrypt numbers.

        Raises:
            UnknownCursorError: The text was not encrypted here, or holds another count.
        """
        numbers = [int(part) for part in self._decrypt(_NUMBERS, text).split(b",")]
        if len(numbers) != count:
            raise UnknownCursorError
        return numbers

    def write_name(self, name: str) -> str:
        """Encrypt the name after which a list goes on."""
        return self._encrypt(_NAME, name.encode())

    def read_name(self, text: str) -> str:
        """Decrypt a name.

        Raises:
            UnknownCursorError: The text was not encrypted here.
        """
        return self._decrypt(_NAME, text).decode()

    def write_position(self, position: FeedPosition) -> str:
        """Encrypt a position in the feed; the text has the same length for all positions."""
        text = self._positions.get(position)
        if text is None:
            numbers = np.array(position.cursors, np.uint64) // SLOTS
            octets = numbers.astype(">u8").view(np.uint8).reshape(SLOTS, 8)
            text = self._encrypt(_POSITION, octets[:, -_NUMBER_BYTES:].tobytes())
            self._positions[position] = text
        return text

    def read_position(self, text: str) -> FeedPosition:
        """Decrypt a position in the feed.

        Raises:
            UnknownCursorError: The text is no position that a cloud on this store encrypted.
        """
        data = self._decrypt(_POSITION, text)
        places = range(0, len(data), _NUMBER_BYTES)
        return FeedPosition.of(int.from_bytes(data[at : at + _NUMBER_BYTES]) for at in places)

    def _encrypt(self, kind: bytes, data: bytes) -> str:
        return base64.urlsafe_b64encode(self._aead.encrypt(data, [kind])).decode().rstrip("=")

    def _decrypt(self, kind: bytes, text: str) -> bytes:
        try:
            data = base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
            return self._aead.decrypt(data, [kind])
        except (InvalidTag, binascii.Error, ValueError) as error:
            raise UnknownCursorError from error

    def number(self, node: str, boot: int, sequence: int) -> int:
        """A 52-bit id of a message, which reveals no count."""
        name = f"{node} {boot} {sequence}".encode()
        digest = hashlib.blake2b(name, key=self._key, digest_size=8).digest()
        return int.from_bytes(digest, "big") >> 12
