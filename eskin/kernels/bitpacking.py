"""Whole numbers of up to 32 bits in as few bits as the greatest needs, side by side in eight lanes.

Number ``k`` is in lane ``k mod 8``. A lane's bits fill words of 32 bits from the lowest bit on; the
lanes' first words come first, then their second ones, so that a processor writes and reads eight
numbers at once. That is the vertical layout of Lemire and Boytsov, "Decoding billions of integers
per second through vectorization", Software: Practice and Experience 45 (2015).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.intrinsics import load, to_bits
from eskin.kernels.jit import inlined, part

if TYPE_CHECKING:
    from numpy.typing import NDArray

LANES: Final = 8
_WORD: Final = 32


@part
def bit_length(number: np.int64) -> int:
    """How many bits a number below 2^53 needs."""
    return (to_bits(np.float64(number)) >> 52) - 1022 if number > 0 else 0


@part
def count_words(n: int, width: int) -> int:
    """How many words of 32 bits take ``n`` numbers of ``width`` bits."""
    steps = (n + LANES - 1) // LANES
    return (steps * width + _WORD - 1) // _WORD * LANES


@inlined
def write_lanes(
    numbers: NDArray[np.uint32], n: int, width: int, out: NDArray[np.uint32], place: int
) -> int:
    """Write numbers; gives where they end.

    Args:
        numbers: The first ``n`` are written; there is room for whole steps of eight.
        n: How many.
        width: Bits of each, 1 to 32.
        out: For the result.
        place: Where it begins.
    """
    for k in range(n, (n + LANES - 1) // LANES * LANES):
        numbers[k] = 0
    held = 0
    for k in range(0, n, LANES):
        if held == 0:
            for lane in range(LANES):
                out[place + lane] = numbers[k + lane]
        else:
            for lane in range(LANES):
                out[place + lane] |= numbers[k + lane] << np.uint32(held)
        held += width
        if held >= _WORD:
            held -= _WORD
            place += LANES
            if held > 0:
                for lane in range(LANES):
                    out[place + lane] = numbers[k + lane] >> np.uint32(width - held)
    return place + LANES if held > 0 else place


@inlined
def read_lanes(
    data: bytes | NDArray[np.uint8], place: int, n: int, width: int, numbers: NDArray[np.uint32]
) -> None:
    """Read numbers.

    Args:
        data: All of them; nothing is checked.
        place: Where they begin.
        n: How many.
        width: Bits of each, 1 to 32.
        numbers: For the result; there is room for whole steps of eight.
    """
    mask = np.uint32(0xFFFFFFFF) >> np.uint32(_WORD - width)
    held = word = 0
    for k in range(0, n, LANES):
        for lane in range(LANES):
            numbers[k + lane] = load(data, place, word + lane, np.uint32) >> np.uint32(held)
        held += width
        if held >= _WORD:
            held -= _WORD
            word += LANES
            if held > 0:
                for lane in range(LANES):
                    more = load(data, place, word + lane, np.uint32) << np.uint32(width - held)
                    numbers[k + lane] |= more
        for lane in range(LANES):
            numbers[k + lane] &= mask
