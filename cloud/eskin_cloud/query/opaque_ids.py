"""Ids and cursors that say nothing of the messages between them.

A place in the feed counts all messages, sealed ones, too: who saw it could count heartbeats. So
places leave the cloud encrypted, under a key of the store, and always as the same text.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
from typing import TYPE_CHECKING, Self

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESSIV
from sqlalchemy import select

from eskin.errors import QueryError
from eskin_cloud.store.schema.tables import feed

if TYPE_CHECKING:
    from sqlalchemy import Connection


class OpaqueIds:
    """Encrypts numbers by AES-SIV (RFC 5297): deterministic, and what was not made here is refused.

    Args:
        key: 32 bytes.
    """

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._aead = AESSIV(key)

    @classmethod
    def of(cls, connection: Connection) -> Self:
        """Those of a store, the same in all processes on it."""
        return cls(connection.execute(select(feed.c.ids)).scalar_one())

    def write(self, *numbers: int) -> str:
        """Numbers as a text that tells none of them."""
        data = ",".join(map(str, numbers)).encode()
        return base64.urlsafe_b64encode(self._aead.encrypt(data, None)).decode().rstrip("=")

    def read(self, text: str, count: int) -> list[int]:
        """The numbers of a text.

        Raises:
            QueryError: It is none of ours, or of another count.
        """
        try:
            data = base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
            numbers = [int(part) for part in self._aead.decrypt(data, None).split(b",")]
        except (InvalidTag, binascii.Error, ValueError) as error:
            raise _refusal() from error
        if len(numbers) != count:
            raise _refusal()
        return numbers

    def number(self, node: str, boot: int, sequence: int) -> int:
        """A number of 52 bit that names a message, and not how many came before it."""
        said = f"{node} {boot} {sequence}".encode()
        digest = hashlib.blake2b(said, key=self._key, digest_size=8).digest()
        return int.from_bytes(digest, "big") >> 12


def _refusal() -> QueryError:
    return QueryError("cursor", "is none of ours; pass on what `next` said, or leave it out")
