"""Whole numbers in as few bytes as they need: 7 bits a byte, the least first (LEB128).

Signed ones are folded first: 0, -1, 1, -2, … become 0, 1, 2, 3, …
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.jit import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

LONGEST: Final = 10
"""Bytes of the greatest number of 64 bits."""


@kernel
def write_varints(numbers: NDArray[np.int64], out: NDArray[np.uint8]) -> int:
    """Write numbers; gives how many bytes they take, ``LONGEST`` each at most."""
    place = 0
    for number in numbers:
        rest = (number << 1) ^ (number >> 63)
        while rest < 0 or rest > 127:
            out[place] = rest & 127 | 128
            rest = rest >> 7 & ((1 << 57) - 1)  # as of a number without a sign
            place += 1
        out[place] = rest
        place += 1
    return place


@kernel
def read_differences(data: bytes, place: int, table: NDArray[np.int64], twice: int) -> int:
    """Read rows of numbers that are stored as differences; gives where they end.

    Args:
        data: What `write_varints` wrote; nothing is checked.
        place: Where they begin.
        table: For the result.
        twice: How many of the first rows are stored as differences of differences.
    """
    for row in range(table.shape[0]):
        place = read_varints(data, place, table[row])
        for _ in range(2 if row < twice else 1):
            for k in range(1, table.shape[1]):
                table[row, k] += table[row, k - 1]
    return place


@kernel
def read_varints(data: bytes, place: int, numbers: NDArray[np.int64]) -> int:
    """Read as many numbers as there is room for; gives where they end.

    Args:
        data: What `write_varints` wrote; nothing is checked.
        place: Where they begin.
        numbers: For the result.
    """
    for k in range(numbers.size):
        folded, shift = np.int64(0), 0
        while True:
            byte = np.int64(data[place])
            folded |= (byte & 127) << shift
            shift += 7
            place += 1
            if byte < 128:
                break
        numbers[k] = (folded >> 1 & ((1 << 63) - 1)) ^ -(folded & 1)
    return place
