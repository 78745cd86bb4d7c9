"""Digests of 8 bytes, of messages and of rows.

By a message's digest a duplicate is told from another message under the same number; by that of a
row's bytes a reader knows that they are those that were written. A block has one digest for both:
of its bytes as the store keeps them, which the same message always gives.

They are the first 8 bytes of SHA-256 (FIPS 180-4): to find other bytes for a digest that is given
takes 2^64 trials. A processor with SHA instructions needs 1.2 us for 2 kB; BLAKE2b needs 1.7 us.
"""

from __future__ import annotations

import hashlib
from typing import Final

DIGEST_BYTES: Final = 8


def digest(data: bytes) -> bytes:
    """The first 8 bytes of SHA-256."""
    return hashlib.sha256(data).digest()[:DIGEST_BYTES]
