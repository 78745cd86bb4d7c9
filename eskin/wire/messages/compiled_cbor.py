"""Parts of kernels that read CBOR items in deterministic encoding (RFC 8949, section 4.2).

Each takes the place of an item and gives the place after it: `NOWHERE` where there is no such item,
or where the place itself is `NOWHERE`, so that a kernel checks once at its end.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.intrinsics import from_bits
from eskin.kernels.jit import part
from eskin.wire.messages.cbor_map import MOST_COUNT

if TYPE_CHECKING:
    from numpy.typing import NDArray

NOWHERE: Final = -1


@part
def read_head(data: NDArray[np.uint8], place: int, major: int) -> tuple[int, int]:
    """An item's number in its shortest form, and where it goes on (RFC 8949, section 3)."""
    if not 0 <= place < len(data) or data[place] >> 5 != major:
        return 0, NOWHERE
    short = data[place] & 31
    place += 1
    if short < 24:
        return short, place
    width = 1 << (short - 24)
    if short > 27 or place + width > len(data):
        return 0, NOWHERE
    number = 0
    for k in range(width):
        number = number << 8 | data[place + k]
    least = 24 if width == 1 else 1 << 4 * width
    return (number, place + width) if number >= least else (0, NOWHERE)


@part
def read_key(data: NDArray[np.uint8], place: int, key: int) -> int:
    """Where a field's value stands."""
    return place + 1 if 0 <= place < len(data) and data[place] == key else NOWHERE


@part
def read_pair(data: NDArray[np.uint8], place: int, key: int) -> int:
    """Where the first of a field's two values stands."""
    return read_key(data, read_key(data, place, key), 0x82)


@part
def read_count(data: NDArray[np.uint8], place: int, key: int) -> tuple[int, int]:
    """The counter of a field."""
    number, behind = read_head(data, read_key(data, place, key), 0)
    return (number, behind) if number <= MOST_COUNT else (0, NOWHERE)


@part
def read_integer(data: NDArray[np.uint8], place: int) -> tuple[int, int]:
    """An integer of 64 bit."""
    if 0 <= place < len(data) and data[place] >> 5 == 1:
        number, behind = read_head(data, place, 1)
        return -1 - number, behind
    return read_head(data, place, 0)


@part
def read_string(data: NDArray[np.uint8], place: int, major: int) -> tuple[int, int]:
    """Where a string begins and ends."""
    length, begin = read_head(data, place, major)
    return (begin, begin + length) if 0 <= length <= len(data) - begin else (0, NOWHERE)


@part
def read_real(data: NDArray[np.uint8], place: int) -> tuple[float, int]:
    """A binary64, or an infinity, whose shortest form has 16 bits."""
    if 0 <= place <= len(data) - 3 and data[place] == 0xF9 and data[place + 2] == 0:
        if data[place + 1] == 0x7C:
            return np.inf, place + 3
        if data[place + 1] == 0xFC:
            return -np.inf, place + 3
    if not 0 <= place <= len(data) - 9 or data[place] != 0xFB:
        return np.nan, NOWHERE
    bits = 0
    for k in range(1, 9):
        bits = bits << 8 | data[place + k]
    value = from_bits(bits)
    return value, place + 9 if abs(value) < np.inf else NOWHERE
