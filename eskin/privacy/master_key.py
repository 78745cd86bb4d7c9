"""The master key, which wraps all others: in a file, or in hardware that never lets it out."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final, Protocol

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from eskin.errors import PrivacyError
from eskin.privacy.subject import KEY_BYTES
from eskin.runtime.files.atomic import make_once, read_private

if TYPE_CHECKING:
    from pathlib import Path

MASTER_FILE: Final = "master.key"
NONCE_BYTES: Final = 12


class MasterKey(Protocol):
    """What a key store needs of its master key.

    Wrapping draws a random nonce of 96 bit: subjects are few, so that none comes twice.
    """

    def wrap(self, data: bytes, context: bytes) -> bytes:
        """Seal, so that only the same context opens it again.

        Raises:
            PrivacyError: The key cannot be used.
        """

    def unwrap(self, wrapped: bytes, context: bytes) -> bytes:
        """Read what `wrap` sealed.

        Raises:
            PrivacyError: It was sealed by another key, for another context, or was changed.
        """


def wrapped_key(path: Path, master: MasterKey) -> bytes:
    """A key in a file of its own, wrapped for that file's name; made where there is none.

    Raises:
        PrivacyError: It cannot be read or made.
    """
    context = path.name.encode()
    wrapped = make_once(path, lambda: master.wrap(os.urandom(KEY_BYTES), context))
    return master.unwrap(wrapped, context)


class FileMasterKey:
    """A master key in a file of its own, mode 0600; made where there is none.

    Args:
        path: The file.

    Raises:
        PrivacyError: It cannot be read or made, or others may read it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        key = make_once(path, lambda: AESGCM.generate_key(256))
        if len(key) != KEY_BYTES:
            raise PrivacyError(f"{path}: {len(key)} bytes are no key of AES-256; restore the file")
        self._aead = AESGCM(read_private(path))

    def wrap(self, data: bytes, context: bytes) -> bytes:
        """See `MasterKey.wrap`."""
        nonce = os.urandom(NONCE_BYTES)
        return nonce + self._aead.encrypt(nonce, data, context)

    def unwrap(self, wrapped: bytes, context: bytes) -> bytes:
        """See `MasterKey.unwrap`.

        Raises:
            PrivacyError: See there.
        """
        try:
            return self._aead.decrypt(wrapped[:NONCE_BYTES], wrapped[NONCE_BYTES:], context)
        except (InvalidTag, ValueError) as error:
            raise PrivacyError(
                f"{context.decode(errors='replace')} was not wrapped by {self._path}"
            ) from error
