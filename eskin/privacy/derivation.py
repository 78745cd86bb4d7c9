"""A key for one start of one process, and its nonces, which never repeat.

Each start draws a salt, which with a key that stays gives (HKDF-SHA-256, RFC 5869) a key of its own
for AES-256-GCM; under it nonces are counted from zero. So nothing needs to be remembered: not after
a power cut, and not where two start from copies of the same files.
"""

from __future__ import annotations

from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from eskin.privacy.subject import KEY_BYTES


def derive(key: bytes, salt: bytes, purpose: bytes) -> AESGCM:
    """The key of one start.

    Args:
        key: The one that stays.
        salt: Drawn at the start.
        purpose: Separates it from keys for other purposes.
    """
    return AESGCM(HKDF(SHA256(), KEY_BYTES, salt, purpose).derive(key))


def nonce(number: int) -> bytes:
    """The nonce of the message with a number, counted from zero."""
    return number.to_bytes(12, "big")
