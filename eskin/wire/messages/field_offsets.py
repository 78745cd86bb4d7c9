"""Where a block's fields lie in its bytes, for kernels that look at stored blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.jit import part

if TYPE_CHECKING:
    from numpy.typing import NDArray

KEYS: Final = 24
"""A block's keys are less."""
N: Final = 9
ENCODING: Final = 11
LOWS: Final = 12
HIGHS: Final = 13
EXPONENT: Final = 15
OFFSET: Final = 16


@part
def find_fields(data: bytes | NDArray[np.uint8]) -> tuple[bool, NDArray[np.int64]]:
    """Whether bytes are one map of fields, and each field's number by its key.

    Of the bounds it is the place where their bytes begin; of a field of two numbers, the second.
    """
    said = np.zeros(KEYS, np.int64)
    place = 1
    while 0 < place < len(data) - 1 and data[place] < KEYS:
        key, major = data[place], data[place + 1] >> 5
        number, begin, place = _item(data, place + 1)
        for _ in range(2 if major == 4 else 1 if major == 6 else 0):
            number, begin, place = _item(data, place)
        said[key] = begin if key in (LOWS, HIGHS) else number
    return place == len(data), said


@part
def _item(data: bytes | NDArray[np.uint8], place: int) -> tuple[int, int, int]:
    """An item's number, where it begins behind its head, and where it ends (RFC 8949, 3).

    Of a tag and an array the end is that of their head; it is negative where there is none.
    """
    if not 0 <= place < len(data):
        return 0, -1, -1
    major, short = data[place] >> 5, data[place] & 31
    width = 0 if short < 24 else 1 << (short - 24)
    begin = place + 1 + width
    if begin > len(data):
        return 0, -1, -1
    number = 0 if width else short
    for k in range(place + 1, begin):
        number = number << 8 | data[k]
    if major == 1:
        return -1 - number, begin, begin
    if major in (2, 3):
        return number, begin, begin + number if 0 <= number <= len(data) - begin else -1
    return number, begin, begin
