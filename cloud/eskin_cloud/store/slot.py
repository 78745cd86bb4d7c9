"""Slots of nodes: what leads each key of a node's tables, so that writers share the store."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from typing import Final

SLOTS: Final = 64


@lru_cache(16_384)
def slot_of(node: str) -> int:
    """The slot of a node, from 0 to 63: the first 8 bytes of its name's SHA-256, modulo 64."""
    return int.from_bytes(hashlib.sha256(node.encode()).digest()[:8]) % SLOTS


def slot_of_cursor(cursor: int) -> int:
    """The slot of a cursor, which is 64 times a number within the slot, plus the slot."""
    return cursor % SLOTS
