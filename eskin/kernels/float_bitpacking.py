"""Intervals of binary32 in fewer bits, every bit of which comes back.

A float's code is its place in the order of all floats: its bits as a whole number, those of
negative ones turned round. Each 256 intervals are stored as

- the least code of the lower bounds, and how far each is above it;
- a width ``w``, and how far the code of each upper bound is from that of ``lo + w``, rounded to
  binary32: more than the least such distance, which is stored first.

Where widths differ little, an upper bound so takes few bits also near zero, where floats lie closer
together than elsewhere. The greatest difference that its bits hold stands for an infinite bound; a
missing sample has two of them. Four words of 32 bits begin a group: least code, ``w``, least
distance, and how many bits the differences of both kinds take (`eskin.kernels.bitpacking`).

``lo + w`` is the only sum of floats here. It is the same for all readers as long as both round to
nearest, see `eskin.kernels.rounding_mode`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.bitpacking import LANES, bit_length, count_words, read_lanes, write_lanes
from eskin.kernels.intrinsics import from_bits32, load, to_bits32
from eskin.kernels.jit import inlined, part

if TYPE_CHECKING:
    from numpy.typing import NDArray

_GROUP: Final = 256
_HEAD: Final = 4
_WORD: Final = 4
_WIDEST: Final = 32
_SIGN: Final = 0x80000000
_ALL: Final = 0xFFFFFFFF
_MOST: Final = 0x7FFFFFFF
_BELOW: Final = 0xFF800000
"""The bits of minus infinity, and of infinity."""
_ABOVE: Final = 0x7F800000
_LOWEST: Final = 0x007FFFFF
"""The code of minus infinity, of the least finite float, and of infinity; beyond are NaN."""
_FINITE: Final = 0x00800000
_HIGHEST: Final = 0xFF800000
_NORMAL: Final = 0x00800000
"""The bits of the least normal float."""
_TINY: Final = 0x00FFFFFF


def most_words(n: int) -> int:
    """The most words of 32 bits that ``n`` intervals take."""
    return 2 * (n + LANES) + _HEAD * (n // _GROUP + 1)


@part
def pack_floats(
    data: NDArray[np.uint8], places: tuple[int, int], n: int, out: NDArray[np.uint32], place: int
) -> int:
    """Write intervals; gives where they end, or -1 where they are too far apart, subnormal or none.

    Args:
        data: With the lower and the upper bounds, little endian.
        places: Where both begin.
        n: How many.
        out: For the result: ``most_words(n)``.
        place: Where it begins.
    """
    lower, upper = np.empty(_GROUP, np.uint32), np.empty(_GROUP, np.uint32)
    for begin in range(0, n, _GROUP):
        size = min(n - begin, _GROUP)
        at = places[0] + _WORD * begin, places[1] + _WORD * begin
        least, bits, width = _look(data, at, lower[:size])
        nearest, upper_bits = _measure(data, at, (_bits(least), width), upper[:size])
        if max(bits, upper_bits) > _WIDEST:
            return -1
        tops = np.uint32(_ALL >> (_WIDEST - bits)), np.uint32(_ALL >> (_WIDEST - upper_bits))
        for k in range(size):
            low, high = np.uint32(lower[k] - least), np.uint32(upper[k] - nearest)
            open_ = load(data, at[0], k, np.uint32) == np.uint32(_BELOW)
            lower[k] = _select(open_, tops[0], low)
            open_ = load(data, at[1], k, np.uint32) == np.uint32(_ABOVE)
            upper[k] = _select(open_, tops[1], high)
        out[place], out[place + 1], out[place + 2] = least, to_bits32(width), nearest
        out[place + 3] = bits | upper_bits << 8
        place = write_lanes(lower, size, bits, out, place + _HEAD)
        place = write_lanes(upper, size, upper_bits, out, place)
    return place


@inlined
def _look(
    data: NDArray[np.uint8], places: tuple[int, int], codes: NDArray[np.uint32]
) -> tuple[np.uint32, int, np.float32]:
    """The least code of the lower bounds, bits of what they are above it, and the least width.

    The width is zero where there is none that is finite and normal.
    """
    least, most, narrow = np.uint32(_ALL), np.uint32(0), np.uint32(_ALL)
    lowest = np.uint32(_ALL)
    for k in range(codes.size):
        lo, hi = load(data, places[0], k, np.float32), load(data, places[1], k, np.float32)
        code = _code(to_bits32(lo))
        codes[k] = code
        lowest, most = min(lowest, code), max(most, code)
        least = min(least, np.uint32(code - _FINITE))  # minus infinity comes round to the end
        narrow = min(narrow, to_bits32(hi - lo))  # the order of floats that are not negative
    width = from_bits32(narrow) if _NORMAL <= narrow < _ABOVE else np.float32(0.0)
    least = np.uint32(least + _FINITE)
    good = lowest >= _LOWEST and most <= _HIGHEST
    bits = bit_length(np.int64(most) - np.int64(least) + 1) if good else _WIDEST + 1
    return least, bits, width


@inlined
def _measure(
    data: NDArray[np.uint8],
    places: tuple[int, int],
    like: tuple[np.uint32, np.float32],
    codes: NDArray[np.uint32],
) -> tuple[np.uint32, int]:
    """The least distance of upper bounds from what is expected, and bits of what is above it."""
    least, most = np.int32(0), np.int32(0)  # about as far as the narrowest one is
    tiny = np.uint32(0)
    for k in range(codes.size):
        lo, code = load(data, places[0], k, np.uint32), _code(load(data, places[1], k, np.uint32))
        expected = _expected(lo, like)
        tiny |= _is_tiny(lo) | _is_tiny(expected)
        codes[k] = np.uint32(code - _code(expected))
        distance = np.int32(codes[k]) & (np.int32(code == np.uint32(_HIGHEST)) - np.int32(1))
        least, most = min(least, np.int32(distance)), max(most, np.int32(distance))
    bits = _WIDEST + 1 if tiny else bit_length(np.int64(most) - np.int64(least) + 1)
    return np.uint32(least), bits


@part
def unpack_floats(
    data: bytes | NDArray[np.uint8], place: int, lo: NDArray[np.uint32], hi: NDArray[np.uint32]
) -> bool:
    """Read intervals; gives whether these are what the data's rest holds.

    Args:
        data: With what `pack_floats` wrote at its end.
        place: Where it begins.
        lo: For the bits of the lower bounds.
        hi: For those of the upper bounds.
    """
    lower, upper = np.empty(_GROUP, np.uint32), np.empty(_GROUP, np.uint32)
    for begin in range(0, lo.size, _GROUP):
        size = min(lo.size - begin, _GROUP)
        first = place + _WORD * _HEAD
        if first > len(data):
            return False
        least, width = load(data, place, 0, np.uint32), load(data, place, 1, np.float32)
        nearest, both = load(data, place, 2, np.uint32), load(data, place, 3, np.uint32)
        bits, upper_bits = both & 255, both >> 8
        second = first + _WORD * count_words(size, bits)
        place = second + _WORD * count_words(size, upper_bits)
        if not 0 < bits <= _WIDEST or not 0 < upper_bits <= _WIDEST or place > len(data):
            return False
        read_lanes(data, first, size, bits, lower)
        read_lanes(data, second, size, upper_bits, upper)
        tops = np.uint32(_ALL >> (_WIDEST - bits)), np.uint32(_ALL >> (_WIDEST - upper_bits))
        like = _bits(least), width
        for k in range(size):
            bits_ = _bits(np.uint32(lower[k] + least))
            lo[begin + k] = _select(lower[k] == tops[0], np.uint32(_BELOW), bits_)
        for k in range(size):
            expected = _code(_expected(lo[begin + k], like))
            bits_ = _bits(np.uint32(expected + upper[k] + nearest))
            hi[begin + k] = _select(upper[k] == tops[1], np.uint32(_ABOVE), bits_)
    return place == len(data)


@inlined
def _expected(lo: np.uint32, like: tuple[np.uint32, np.float32]) -> np.uint32:
    """The bits of ``lo + width``.

    Args:
        lo: The bits of a lower bound.
        like: Those that are taken where it is infinite, and the width.
    """
    finite = _select(lo == np.uint32(_BELOW), like[0], lo)
    return to_bits32(from_bits32(finite) + like[1])


@inlined
def _select(whether: np.bool, one: np.uint32, other: np.uint32) -> np.uint32:
    """One or the other, without a branch."""
    mask = np.uint32(np.uint32(0) - np.uint32(whether))
    return np.uint32((one & mask) | (other & ~mask))


@inlined
def _is_tiny(bits: np.uint32) -> np.uint32:
    """1 if a float is subnormal, else 0: some libraries have processors take it for zero."""
    return np.uint32(np.uint32(np.uint32(bits << np.uint32(1)) - np.uint32(1)) < np.uint32(_TINY))


@inlined
def _code(bits: np.uint32) -> np.uint32:
    """The place in the order of floats of one that has these bits."""
    return np.uint32(bits ^ (np.uint32(np.int32(bits) >> 31) | np.uint32(_SIGN)))


@inlined
def _bits(code: np.uint32) -> np.uint32:
    """The bits of the float that has this place."""
    return np.uint32(code ^ (np.uint32(~(np.int32(code) >> 31)) | np.uint32(_SIGN)))
