"""Encode and decode samples column after column, for long storage.

What is kept for long is read a column at a time: so each column has an exponent, an offset and
codes of its own, those of a patch with one column (`eskin.wire.frames.sample_codec`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eskin.errors import MessageError
from eskin.kernels.intrinsics import to_bits
from eskin.kernels.jit import kernel, part
from eskin.wire.frames.sample_codec import (
    _FAR,
    _FAULTS,
    _MOST_SPAN,
    COARSEST,
    FINEST,
    PADDING,
    _encode,
    _scale,
    decode_codes,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats

    Integers = NDArray[np.int64]

_MOST_QUANTA = 2.0**62
_LEAST_GROUP = 64
"""A byte for each 64 samples is the least that codes take, for bounds and for widths."""


class ColumnCodes(NamedTuple):
    """Encoded samples of columns.

    Attributes:
        exponents: Of each column: a quantum is ``2^exponent``.
        offsets: Of each column: quanta that are added to each code of a bound.
        sizes: Bytes of each column's codes.
        codes: Of all columns.
    """

    exponents: Integers
    offsets: Integers
    sizes: Integers
    codes: bytes


def encode_columns(lo: Floats, hi: Floats, counts: Integers, finest: int) -> ColumnCodes:
    """Encode samples, rounded outward as `encode_samples` does.

    Args:
        lo: Lower bounds, column after column; -inf where unknown.
        hi: Upper bounds.
        counts: How many samples each column has.
        finest: Least exponent of a quantum.

    Raises:
        MessageError: A sample is an empty interval, or no interval.
    """
    encoded = _encoded(lo, hi, counts, finest, exact=False)
    if encoded is None:
        raise MessageError("a column's samples span more quanta than codes can")
    return encoded


def encode_columns_exactly(lo: Floats, hi: Floats, counts: Integers) -> ColumnCodes | None:
    """Encode samples so that decoded they are equal; ``None`` if a column needs longer codes.

    Args:
        lo: Lower bounds, column after column; -inf where unknown.
        hi: Upper bounds.
        counts: How many samples each column has.

    Raises:
        MessageError: A sample is an empty interval, or no interval.
    """
    return _encoded(lo, hi, counts, FINEST, exact=True)


def decode_columns(
    encoded: ColumnCodes, counts: Integers, columns: Sequence[int] | None = None
) -> tuple[Floats, Floats]:
    """Decode samples of some columns, or of all; gives lower and upper bounds as `encode_columns`.

    Raises:
        MessageError: The parts do not fit each other, or the codes are not those of any samples.
    """
    if not encoded.exponents.size == encoded.offsets.size == encoded.sizes.size == counts.size:
        raise MessageError("columns differ in number between exponents, offsets, sizes and counts")
    if np.any(encoded.sizes < 0) or int(encoded.sizes.sum()) != len(encoded.codes):
        raise MessageError(f"codes have {len(encoded.codes)} bytes, not what their sizes say")
    if np.any(encoded.exponents < FINEST) or np.any(encoded.exponents > COARSEST):
        raise MessageError(f"an exponent is not in {FINEST} to {COARSEST}")
    if np.any(np.abs(encoded.offsets.astype(np.float64)) > _MOST_QUANTA):
        raise MessageError("an offset is beyond 2^62")
    if np.any(counts < 0) or np.any(counts > _LEAST_GROUP * encoded.sizes):
        raise MessageError("a column's codes are too few for its samples")
    chosen = np.arange(counts.size) if columns is None else np.asarray(columns, np.int64)
    size = int(counts[chosen].sum())
    lo, hi = np.full(size, -np.inf), np.full(size, np.inf)
    data = np.frombuffer(encoded.codes + bytes(PADDING), np.uint8)
    ends = np.cumsum(encoded.sizes)
    heads = encoded.exponents, encoded.offsets, ends - encoded.sizes, ends, counts
    fault, place = _decode_all(data, heads, chosen, lo, hi)
    if fault:
        raise MessageError(f"codes cannot be read from byte {place} on: {_FAULTS[fault]}")
    return lo, hi


def columns_of(chosen: Sequence[tuple[ColumnCodes, int]]) -> ColumnCodes:
    """One column of each of some encoded samples, as columns of one.

    Raises:
        MessageError: Sizes are not those of the codes.
    """
    heads, codes = [], []
    for encoded, column in chosen:
        end = int(encoded.sizes[: column + 1].sum())
        size = int(encoded.sizes[column])
        if not 0 <= size <= end <= len(encoded.codes):
            raise MessageError(f"codes have {len(encoded.codes)} bytes, not what their sizes say")
        heads.append((encoded.exponents[column], encoded.offsets[column], size))
        codes.append(encoded.codes[end - size : end])
    exponents, offsets, sizes = np.array(heads, np.int64).T
    return ColumnCodes(exponents, offsets, sizes, b"".join(codes))


def _encoded(
    lo: Floats, hi: Floats, counts: Integers, finest: int, *, exact: bool
) -> ColumnCodes | None:
    if not lo.size == hi.size == counts.sum():
        raise MessageError(f"there are {lo.size} and {hi.size} bounds of {counts.sum()} samples")
    if not np.all((lo <= hi) & (lo < np.inf) & (hi > -np.inf)):
        raise MessageError("a sample is an empty interval; encode what is unknown as unbounded")
    exponents, offsets, sizes = (np.zeros(counts.size, np.int64) for _ in range(3))
    groups = np.minimum(counts, 1) - (1 - counts) // _LEAST_GROUP
    out = np.empty(int((2 * (3 * counts + groups)).sum()) + PADDING, np.uint8)
    if not _encode_all(lo, hi, counts, (finest, exact), (exponents, offsets, sizes, out)):
        return None
    return ColumnCodes(exponents, offsets, sizes, out[: int(sizes.sum())].tobytes())


@part
def _order_longest(counts: Integers) -> NDArray[np.int32]:
    """Cells of the longest column, each with the one before it, which predicts it."""
    longest = 0
    for count in counts:
        longest = max(longest, count)
    order = np.empty((longest, 2), np.int32)
    for k in range(longest):
        order[k, 0], order[k, 1] = k, k - 1
    return order


@kernel
def _encode_all(
    lo: Floats,
    hi: Floats,
    counts: Integers,
    how: tuple[int, bool],
    out: tuple[Integers, Integers, Integers, NDArray[np.uint8]],
) -> bool:
    """Write each column's codes; gives whether they are exact where they have to be."""
    finest, exact = how
    exponents, offsets, sizes, codes = out
    order, begin, place = _order_longest(counts), 0, 0
    for column in range(counts.size):
        end = begin + counts[column]
        low, high, cells = lo[begin:end], hi[begin:end], order[: counts[column]]
        far = np.inf if exact else _FAR
        if exact:
            exponent, offset, fits = _exact_scale(low, high)
            if not fits:
                return False
        else:
            exponent, offset = _scale(low, high, cells, finest)
        starts = min(counts[column], 1)
        size = _encode(low, high, (cells, starts), exponent, offset, far, codes[place:])
        exponents[column], offsets[column], sizes[column] = exponent, offset, size
        begin, place = end, place + size
    return True


@part
def _exact_scale(lo: Floats, hi: Floats) -> tuple[int, int, bool]:
    """The coarsest exponent of which all bounds are multiples, the offset, and whether it fits."""
    exponent, lowest, highest = COARSEST, np.inf, -np.inf
    for side in (lo, hi):
        for value in side:
            if abs(value) < np.inf:
                lowest, highest = min(lowest, value), max(highest, value)
                if value != 0.0:
                    exponent = min(exponent, _unit(value))
    if lowest > highest:
        return 0, 0, True
    if exponent < FINEST:
        return 0, 0, False
    quantum = 2.0**-exponent
    first, last = lowest * quantum, highest * quantum
    fits = max(abs(first), abs(last)) <= _MOST_QUANTA and last - first <= _MOST_SPAN
    return exponent, (int(first) if fits else 0), fits


@part
def _unit(value: float) -> int:
    """The exponent of a float's last bit that is set."""
    bits = to_bits(value)
    mantissa, power = bits & ((1 << 52) - 1), (bits >> 52) & 2047
    if power:
        mantissa |= 1 << 52
    else:
        power = 1
    while not mantissa & 255:
        mantissa, power = mantissa >> 8, power + 8
    while not mantissa & 1:
        mantissa, power = mantissa >> 1, power + 1
    return power - 1075


@kernel
def _decode_all(
    data: NDArray[np.uint8],
    heads: tuple[Integers, Integers, Integers, Integers, Integers],
    chosen: Integers,
    lo: Floats,
    hi: Floats,
) -> tuple[int, int]:
    """Read the codes of some columns; gives what is wrong, or 0, and where."""
    exponents, offsets, begins, ends, counts = heads
    order, begin = _order_longest(counts), 0
    for column in chosen:
        end = begin + counts[column]
        cells = order[: counts[column]], min(counts[column], 1)
        within, scale = (begins[column], ends[column]), (exponents[column], offsets[column])
        fault, place = decode_codes(data, within, cells, scale, lo[begin:end], hi[begin:end])
        if fault:
            return fault, place
        begin = end
    return 0, 0
