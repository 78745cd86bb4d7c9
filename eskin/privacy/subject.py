"""A subject: one key that encrypts the data of a person, or of no one yet."""

from __future__ import annotations

import hashlib
import hmac
import os
from dataclasses import dataclass, field
from typing import Final, Self

import cbor2

from eskin.errors import PrivacyError

KEY_BYTES: Final = 32
"""A subject's key is for AES-256."""
_SALT_BYTES: Final = 16
_PSEUDONYM_BYTES: Final = 16
LONGEST_NAME: Final = 200


@dataclass(frozen=True, slots=True)
class Subject:
    """Whose data they are.

    Attributes:
        pseudonym: HMAC-SHA-256 of salt and name under the site's secret, its first 16 bytes.
        name: As the site knows the person; empty for an unassigned key, and where it is unknown.
        salt: Drawn for this subject and destroyed with its key: the same name later gives another
            pseudonym, which cannot be linked to this one, not even with the site's secret.
        key: What its data are sealed under.
    """

    pseudonym: str
    name: str = field(repr=False)
    salt: bytes = field(repr=False)
    key: bytes = field(repr=False)

    @classmethod
    def make(cls, name: str, *, secret: bytes) -> Self:
        """A new subject.

        Args:
            name: Empty for an unassigned key.
            secret: The site's.
        """
        salt = os.urandom(_SALT_BYTES)
        digest = hmac.digest(secret, salt + name.encode(), hashlib.sha256)
        return cls(digest[:_PSEUDONYM_BYTES].hex(), name, salt, os.urandom(KEY_BYTES))

    def encode(self) -> bytes:
        """All of it but the pseudonym, to be wrapped."""
        return cbor2.dumps([self.name, self.salt, self.key])

    @classmethod
    def decode(cls, pseudonym: str, data: bytes) -> Self:
        """Read what `encode` wrote.

        Raises:
            PrivacyError: It is none.
        """
        try:
            name, salt, key = cbor2.loads(data)
            return cls(pseudonym, str(name), bytes(salt), bytes(key))
        except (cbor2.CBORError, ValueError, TypeError) as error:
            raise PrivacyError(f"the key of subject {pseudonym} cannot be read") from error


def is_pseudonym(text: object) -> bool:
    """Whether something is a pseudonym: 32 hexadecimal digits."""
    return (
        isinstance(text, str)
        and len(text) == 2 * _PSEUDONYM_BYTES
        and set(text) <= set("0123456789abcdef")
    )
