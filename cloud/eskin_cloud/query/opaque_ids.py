"""Ids and cursors that reveal no number of messages.

A cursor counts all messages, including sealed ones: a reader could count heartbeats. So cursors
leave the cloud encrypted, deterministically, under a key of the store.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
from typing import TYPE_CHECKING, Self

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESSIV
from sqlalchemy import select

from eskin_cloud.query.cursors import invalid_cursor
from eskin_cloud.store.schema.tables import feed

if TYPE_CHECKING:
    from sqlalchemy import Connection


class OpaqueIds:
    """Encrypts numbers by AES-SIV (RFC 5297): deterministic and authenticated.

    Args:
        key: 32 bytes.
    """

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._aead = AESSIV(key)

    @classmethod
    def of(cls, connection: Connection) -> Self:
        """Ids under a store's key, the same in all processes."""
        return cls(connection.execute(select(feed.c.cursor_key)).scalar_one())

    def write(self, *numbers: int) -> str:
        """Encrypt numbers."""
        data = ",".join(map(str, numbers)).encode()
        return base64.urlsafe_b64encode(self._aead.encrypt(data, None)).decode().rstrip("=")

    def read(self, text: str, count: int) -> list[int]:
        """Decrypt numbers.

        Raises:
            QueryError: The text was not encrypted here, or holds another count.
        """
        try:
            data = base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
            numbers = [int(part) for part in self._aead.decrypt(data, None).split(b",")]
        except (InvalidTag, binascii.Error, ValueError) as error:
            raise invalid_cursor() from error
        if len(numbers) != count:
            raise invalid_cursor()
        return numbers

    def number(self, node: str, boot: int, sequence: int) -> int:
        """A 52-bit id of a message, which reveals no count."""
        name = f"{node} {boot} {sequence}".encode()
        digest = hashlib.blake2b(name, key=self._key, digest_size=8).digest()
        return int.from_bytes(digest, "big") >> 12
