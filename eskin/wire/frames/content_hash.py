"""The name of a description: the hash of its bytes.

All 32 bytes of SHA-256 (FIPS 180-4), where digests of messages have 8 (`eskin.runtime.digest`):
gateways and clouds keep descriptions of many nodes under their hashes, and a frame is read by the
description that it names. With a truncated hash a node could search for two descriptions with one
name (2^32 trials for 8 bytes, 2^64 for 16), give one to the gateway and the other to the cloud, and
have its samples read in two ways. No attack on the whole hash is known.
"""

from __future__ import annotations

import hashlib
from typing import Final

HASH_BYTES: Final = 32


def content_hash(data: bytes) -> bytes:
    """SHA-256 of a patch's or a layout's bytes."""
    return hashlib.sha256(data).digest()
