"""How items of CBOR begin, for those who put what is encoded already behind it."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

BYTES: Final = 2
"""Major type of byte strings."""
TEXT: Final = 3
"""Major type of texts."""
ARRAY: Final = 4
"""Major type of arrays."""
_WIDTHS: Final = ((24, 256, 1), (25, 65_536, 2), (26, 1 << 32, 4), (27, 1 << 64, 8))


@lru_cache(4096)
def opening(major: int, number: int) -> bytes:
    """The shortest head of an item (RFC 8949, section 3).

    Args:
        major: Its major type.
        number: Its length, or how many items it holds.
    """
    if number < 24:
        return bytes((major << 5 | number,))
    short, _, width = next(found for found in _WIDTHS if number < found[1])
    return bytes((major << 5 | short,)) + number.to_bytes(width)
