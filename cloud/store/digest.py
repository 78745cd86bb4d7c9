"""Digests of 8 bytes, of messages and of rows.

By a message's digest a duplicate is told from another message under the same number; by that of a
row's bytes a reader knows that they are those that were written.

They are the first 8 bytes of SHA-256 (FIPS 180-4): to find other bytes for a digest that is given
takes 2^64 trials, and a processor with SHA instructions needs some 2 us for a block.
"""

from __future__ import annotations

import hashlib
from typing import Final

DIGEST_BYTES: Final = 8


def digest(data: bytes) -> bytes:
    """The first 8 bytes of SHA-256."""
    return hashlib.sha256(data).digest()[:DIGEST_BYTES]


def checksum(data: bytes) -> int:
    """The same as a signed 64-bit integer, as a row keeps it."""
    return int.from_bytes(digest(data), "big", signed=True)
