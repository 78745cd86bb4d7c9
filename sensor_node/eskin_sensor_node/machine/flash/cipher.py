"""Flash encryption, as a microcontroller has it: between the firmware and its storage chip."""

from __future__ import annotations

import itertools
import os
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Final

from cryptography.exceptions import InvalidTag

from eskin.privacy.derivation import derive, nonce
from eskin.privacy.sealed_message import SALT_BYTES

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.ciphers.aead import AESGCM

_NONCE_BYTES: Final = 12
_HEAD: Final = SALT_BYTES + _NONCE_BYTES
_KEPT: Final = 256
_PURPOSE: Final = b"eskin flash 1"


class Cipher:
    """AES-256-GCM; one for each opening of a flash, whose nonces it counts.

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
