"""Codes of 16 bit as differences, their bits side by side: written and read.

A run of codes ``x`` is given by a start ``v``, a slope ``s`` and residuals ``r``, modulo 2^16, so
that every run comes back exactly; ``x`` before the first is ``v``, ``d`` before the first ``s``:

- order 0: ``x_k = v + r_k``
- order 1: ``x_k = x_(k-1) + r_k``
- order 2: ``x_k = x_(k-1) + d_k`` with ``d_k = d_(k-1) + r_k``

Residuals are folded (0, -1, 1, -2, … become 0, 1, 2, 3, …) and stand in groups of 32 with as many
bits as the group's greatest needs: start and slope, all groups' widths, then the bits, each group
from a whole byte on. That is frame-of-reference packing over differences, see Lemire and Boytsov,
"Decoding billions of integers per second through vectorization", Software: Practice and Experience
45 (2015).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from eskin.kernels.intrinsics import load
from eskin.kernels.jit import inlined, kernel, part

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.kernels.arithmetic import Floats

_Run: TypeAlias = "tuple[Any, Any, Any, Any]"
"""A run that is being read: where its next width and its next bits are, its value, its slope."""

ORDERS: Final = 3
PADDING: Final = 8
"""Bytes that must follow a run: eight are loaded at a time."""
_GROUP: Final = 32
_HEAD: Final = 4
_TOP: Final = 0xFFFF
_UNBOUNDED: Final = 65_535


def run_limit(n: int) -> int:
    """The most bytes that a run of so many codes takes."""
    return _HEAD + -(-n // _GROUP) + 2 * n + PADDING


@kernel
def pack_run(codes: NDArray[np.int64], order: int, out: NDArray[np.uint8]) -> int:
    """Write a run of codes; gives how many bytes it takes.

    Args:
        codes: Whole numbers, of which the last 16 bits count; shape ``(n,)``.
        order: Of the residuals.
        out: For the result, ``run_limit(n)`` bytes.
    """
    n = codes.size
    value, slope = _start(codes, order)
    out[0], out[1] = value & 255, value >> 8 & 255
    out[2], out[3] = slope & 255, slope >> 8 & 255
    place = _HEAD + (n + _GROUP - 1) // _GROUP
    out[_HEAD:place] = 0
    folded = np.empty(_GROUP, np.int64)
    for begin in range(0, n, _GROUP):
        size = min(n - begin, _GROUP)
        all_bits = 0
        for k in range(size):
            step = codes[begin + k] - value
            folded[k] = _fold(step - slope if order == 2 else step)
            all_bits |= folded[k]
            if order > 0:
                value, slope = codes[begin + k], step
        width = _bit_length(all_bits)
        out[_HEAD + begin // _GROUP] = width
        place = _write_bits(folded, size, width, out, place)
    return place


@part
def _start(codes: NDArray[np.int64], order: int) -> tuple[int, int]:
    """The start and the slope for which the first residuals are small."""
    if order == 0:
        return (codes.min() + codes.max()) // 2, 0
    slope = codes[1] - codes[0] if order == 2 and codes.size > 1 else 0
    return codes[0] - slope, slope


@part
def _fold(residual: int) -> int:
    small = ((residual + 32_768) & _TOP) - 32_768
    return (small << 1) ^ (small >> 63)


@part
def _bit_length(bits: int) -> int:
    width = 0
    while bits >> width:
        width += 1
    return width


@part
def _write_bits(
    folded: NDArray[np.int64], size: int, width: int, out: NDArray[np.uint8], place: int
) -> int:
    """Write a group from a byte on; gives where it ends."""
    waiting = held = 0
    for k in range(size):
        waiting |= folded[k] << held
        held += width
        while held >= 8:
            out[place] = waiting & 255
            waiting, held, place = waiting >> 8, held - 8, place + 1
    if held:
        out[place] = waiting
        place += 1
    return place


@kernel
def unpack_run(data: bytes, place: int, order: int, codes: NDArray[np.uint16]) -> int:
    """Read a run of codes; gives where it ends.

    Args:
        data: With ``PADDING`` bytes behind the run.
        place: Where it begins.
        order: Of the residuals.
        codes: For the result, shape ``(n,)``.
    """
    n = codes.size
    value, slope = load(data, place, 0, np.uint16), load(data, place, 1, np.int16)
    widths = place + _HEAD
    bits = widths + (n + _GROUP - 1) // _GROUP
    for begin in range(0, n, _GROUP):
        size, width = min(n - begin, _GROUP), data[widths + begin // _GROUP]
        for k in range(size):
            slope = _residual(data, bits, k * width, width) + (slope if order == 2 else 0)
            code = value + slope
            codes[begin + k] = code & _TOP
            value = code if order > 0 else value
        bits += (size * width + 7) >> 3
    return bits


@kernel
def unpack_bounds(
    data: bytes, first: int, blocks: NDArray[np.int64], lo: Floats, hi: Floats
) -> None:
    """Read blocks of ``q16``: each a run of lower codes, then one of what the upper are above them.

    Args:
        data: With ``PADDING`` bytes behind the last run.
        first: Where the first block begins.
        blocks: Of each block how many samples it has, the order of both runs, how many bytes they
            take, the scale's exponent, at most 960 in size, and its offset; shape ``(6, blocks)``.
        lo: For the result, all blocks' in their order.
        hi: For the result.
    """
    done, behind = 0, first
    codes, above = np.empty(_GROUP, np.int32), np.empty(_GROUP, np.int32)
    for block in range(blocks.shape[1]):
        n, order, order_w, size_, exponent, offset_ = blocks[:, block]
        place, behind = behind, behind + size_
        scale, offset = 2.0**exponent, np.float64(offset_)
        at, at_w = _open(data, place, n), _open(data, _skip(data, place, n), n)
        for begin in range(0, n, _GROUP):
            size = min(n - begin, _GROUP)
            at = _unpack_group(data, at, order, size, codes)
            at_w = _unpack_group(data, at_w, order_w, size, above)
            _scale(codes, above, (offset, scale), lo[done : done + size], hi[done : done + size])
            done += size


@part
def _open(data: bytes, place: int, n: int) -> _Run:
    """Where a run's widths and its bits are, its start and its slope."""
    value, slope = load(data, place, 0, np.uint16), load(data, place, 1, np.int16)
    widths = place + _HEAD
    return widths, widths + (n + _GROUP - 1) // _GROUP, np.int64(value), np.int64(slope)


@inlined
def _unpack_group(data: bytes, at: _Run, order: int, size: int, codes: NDArray[np.int32]) -> _Run:
    """Read the next group of a run; gives where the one after it is read."""
    widths, bits, value, slope = at
    width = np.int64(data[widths])
    for k in range(size):
        codes[k] = _residual(data, bits, k * width, width)
    if order == 0:
        for k in range(size):
            codes[k] = (value + codes[k]) & _TOP
    elif order == 1:
        for k in range(size):
            value += codes[k]
            codes[k] = value & _TOP
    else:
        for k in range(size):
            slope += codes[k]
            value += slope
            codes[k] = value & _TOP
    return widths + 1, bits + ((size * width + 7) >> 3), value, slope


@inlined
def _scale(
    codes: NDArray[np.int32],
    above: NDArray[np.int32],
    scale: tuple[float, float],
    lo: Floats,
    hi: Floats,
) -> None:
    """Bounds of a group; the sum of two whole numbers is rounded once, as that of integers is."""
    for k in range(lo.size):
        code, upper = codes[k], (codes[k] + above[k]) & _TOP
        lo[k] = -np.inf if code == _UNBOUNDED else (scale[0] + np.float64(code)) * scale[1]
        hi[k] = np.inf if upper == _UNBOUNDED else (scale[0] + np.float64(upper)) * scale[1]


@part
def _skip(data: bytes, place: int, n: int) -> int:
    """Where a run ends."""
    widths = place + _HEAD
    place = widths + (n + _GROUP - 1) // _GROUP
    for begin in range(0, n, _GROUP):
        place += (min(n - begin, _GROUP) * data[widths + begin // _GROUP] + 7) >> 3
    return place


@inlined
def _residual(data: bytes, place: int, bit: Any, width: Any) -> Any:
    """A residual, unfolded."""
    folded = load(data, place + (bit >> 3), 0, np.int64) >> (bit & 7) & ((1 << width) - 1)
    return (folded >> 1) ^ -(folded & 1)
