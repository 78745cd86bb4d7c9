"""A patch's samples as bytes: rounded outward to quanta, differenced, packed into few bits.

A bound is a whole number of quanta of ``2^exponent``, so that every decoder gets exactly the same
binary64, which encloses what was encoded. ``docs/messages.md`` describes the codes;
`eskin_sensor_node.firmware.sample_codec` is the twin in plain Python, equal to the byte. Packing in
groups: Lemire and Boytsov, "Decoding billions of integers per second through vectorization",
Software: Practice and Experience 45 (2015).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.errors import MessageError
from eskin.interval import Interval
from eskin.kernels.intrinsics import load
from eskin.kernels.jit import kernel, part

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats

FINEST: Final = -1000
COARSEST: Final = 930
"""Least and greatest exponent of a quantum: it and its reciprocal are normal floats."""
MOST_OFFSET: Final = 2**53 - 2**26
"""Limit of offsets: with any code added, a whole number that binary64 holds."""
MOST_ROWS: Final = 1000
MOST_COLUMNS: Final = 64
MOST_STRIDE: Final = 16
_FAR: Final = 2.0**950
_GROUP: Final = 64
_BITS: Final = 24
_MODULUS: Final = 1 << _BITS
_HALF: Final = _MODULUS >> 1
_UNKNOWN, _NO_LOWER, _NO_UPPER, _BOUNDED = range(4)
_MOST_SPAN: Final = _MODULUS - 1 - _BOUNDED
PADDING: Final = 4
"""Bytes that must follow codes."""
_CUT, _WIDE, _LOOSE, _FILLING, _NAMED, _MORE = range(1, 7)
_FAULTS: Final = {
    _CUT: "they end in the middle of a group",
    _WIDE: f"a group has more than {_BITS} bits a code",
    _LOOSE: "a group has more bits a code than its codes need",
    _FILLING: "a group is not filled up with zeros",
    _NAMED: "an unknown sample has a difference of its own",
    _MORE: "something follows the last group",
}


class Sampling(NamedTuple):
    """Which cells of a patch's matrix hold a sample.

    Attributes:
        rows: Instants.
        columns: Channels.
        first_row: Number of the first row in the node's schedule.
        strides: For each column ``k``: it is sampled in rows whose number is a multiple of ``2^k``.
            Empty where every row holds a sample of each column.
    """

    rows: int
    columns: int
    first_row: int = 0
    strides: bytes = b""

    @property
    def counts(self) -> list[int]:
        """How many samples each column has."""
        if not self.strides:
            return [self.rows] * self.columns
        # The first row that is sampled may lie behind the last.
        steps = [1 << stride for stride in self.strides]
        return [max(0, -((-self.first_row % step - self.rows) // step)) for step in steps]

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Which cells hold a sample, shape ``(rows, columns)``."""
        numbers = self.first_row % 2**MOST_STRIDE + np.arange(self.rows)[:, np.newaxis]
        steps = 1 << np.frombuffer(self.strides or bytes(self.columns), np.uint8).astype(np.int64)
        return np.asarray(numbers % steps == 0)

    @property
    def limit(self) -> int:
        """The most bytes that their codes take, whatever they are."""
        counts = self.counts
        samples, starts = sum(counts), sum(map(bool, counts))
        groups = -(-starts // _GROUP) - (-(samples - starts) // _GROUP)
        return 2 * (samples * _BITS // 8 + groups)


class SampleCodes(NamedTuple):
    """Encoded samples.

    Attributes:
        exponent: A quantum is ``2^exponent``.
        offset: Quanta that are added to each code of a bound.
        codes: Differences, packed.
    """

    exponent: int
    offset: int
    codes: bytes


def finest_exponent(least_width: float) -> int:
    """The exponent of the quantum: at most 1/64 of the least width that a patch states."""
    return min(max(math.frexp(least_width)[1] - 7, FINEST), COARSEST)


def encode_samples(values: Interval, sampling: Sampling, least_width: float) -> SampleCodes:
    """Encode samples.

    Decoded, a bound lies at most a quantum farther out; farther than ``2^950`` it is unbounded. The
    quantum is the greatest power of two up to 1/64 of the least width, and coarser only where the
    samples' hull has more than 2^24 of them, or a bound is more than 2^52 of them away from zero.

    Args:
        values: Shape ``(rows, columns)``; unbounded on both sides where nothing is known. Cells
            that hold no sample do not count.
        sampling: Which cells hold a sample.
        least_width: As the patch states it, in its unit.

    Raises:
        MessageError: The shapes differ, or a sample is an empty interval.
    """
    if values.shape != (sampling.rows, sampling.columns):
        raise MessageError(
            f"samples have shape {values.shape}; expected {(sampling.rows, sampling.columns)}"
        )
    lo, hi = np.ascontiguousarray(values.inf).ravel(), np.ascontiguousarray(values.sup).ravel()
    if not np.all((lo < np.inf) & (hi > -np.inf)):
        raise MessageError("a sample is an empty interval; encode what is unknown as unbounded")
    cells = _cells(*sampling)
    exponent, offset = _scale(lo, hi, cells[0], finest_exponent(least_width))
    out = np.empty(sampling.limit + PADDING, np.uint8)
    size = _encode(lo, hi, cells, exponent, offset, _FAR, out)
    return SampleCodes(exponent, offset, out[:size].tobytes())


class EncodedMatrices(NamedTuple):
    """Several matrices of samples, encoded.

    Attributes:
        exponents: Of each.
        offsets: Of each.
        ends: Where the codes of each begin, and where the last ones end.
        codes: Differences, packed, one matrix after the other.
    """

    exponents: NDArray[np.int64]
    offsets: NDArray[np.int64]
    ends: NDArray[np.int64]
    codes: NDArray[np.uint8]


def encode_matrices(
    lo: Floats, hi: Floats, sampling: Sampling, least_width: float
) -> EncodedMatrices:
    """Encode matrices that are sampled alike, each as `encode_samples` does.

    Args:
        lo: Lower bounds, shape ``(matrices, rows·columns)``; no sample is an empty interval.
        hi: Upper bounds.
        sampling: Which cells hold a sample.
        least_width: As their patch states it.
    """
    numbers = np.empty((3, len(lo) + 1), np.int64)
    out = np.empty(sampling.limit * len(lo) + PADDING, np.uint8)
    _encode_all(lo, hi, _cells(*sampling), finest_exponent(least_width), numbers, out)
    exponents, offsets, ends = numbers
    return EncodedMatrices(exponents[:-1], offsets[:-1], ends, out[: ends[-1]])


def decode_samples(encoded: SampleCodes, sampling: Sampling) -> Interval:
    """Decode samples; cells that hold none are unbounded on both sides.

    Args:
        encoded: Exponent and offset within their limits.
        sampling: Which cells hold a sample.

    Raises:
        MessageError: The codes are not those that `encode_samples` writes for any samples.
    """
    lo = np.full(sampling.rows * sampling.columns, -np.inf)
    hi = np.full(sampling.rows * sampling.columns, np.inf)
    data = np.frombuffer(encoded.codes + bytes(PADDING), np.uint8)
    cells = _cells(*sampling)
    scale = encoded.exponent, encoded.offset
    fault, place = decode_codes(data, (0, len(encoded.codes)), cells, scale, lo, hi)
    if fault:
        raise MessageError(f"codes cannot be read from byte {place} on: {_FAULTS[fault]}")
    return Interval(lo, hi).reshape(sampling.rows, sampling.columns)


def _cells(
    rows: int, columns: int, first_row: int, strides: bytes
) -> tuple[NDArray[np.int32], int]:
    steps = np.frombuffer(strides or bytes(columns), np.uint8)
    return order_cells(rows, columns, first_row % 2**MOST_STRIDE, steps)


@kernel
def order_cells(
    rows: int, columns: int, first_row: int, strides: NDArray[np.uint8]
) -> tuple[NDArray[np.int32], int]:
    """Cells in the order of their codes, each with the cell that predicts it, or -1.

    First come the columns' first samples; the one before in this list predicts each. Then come all
    others, row after row; the one before in its column predicts each. Gives how many are first.
    """
    starts = 0
    for column in range(columns):
        starts += (-first_row) & ((1 << strides[column]) - 1) < rows
    order = np.empty((rows * columns, 2), np.int32)
    last = np.full(columns, -1, np.int32)
    previous, first, later = -1, 0, starts
    densest = (1 << strides.min()) - 1 if columns else 0
    for row in range(rows):
        if (first_row + row) & densest:  # else few samples in many rows would take long
            continue
        for column in range(columns):
            if (first_row + row) & ((1 << strides[column]) - 1):
                continue
            cell = row * columns + column
            if last[column] < 0:
                order[first, 0], order[first, 1] = cell, previous
                previous, first = cell, first + 1
            else:
                order[later, 0], order[later, 1] = cell, last[column]
                later += 1
            last[column] = cell
    return order[:later], starts


@part
def _quanta_down(value: float, exponent: int) -> int:
    """The greatest number of quanta that is not above a value."""
    quanta = int(np.floor(value * 2.0**-exponent))
    # The product is exact, or so small that it was rounded to zero.
    return quanta - 1 if np.float64(quanta) * 2.0**exponent > value else quanta


@part
def _within_reach(lo: float, hi: float, far: float) -> tuple[float, float]:
    return (
        -np.inf if lo < -far else min(lo, far),
        np.inf if hi > far else max(hi, -far),
    )


@part
def _exponent(size: float, bits: int) -> int:
    return math.frexp(size)[1] - bits if size > 0.0 else FINEST


@kernel
def _scale(lo: Floats, hi: Floats, order: NDArray[np.int32], finest: int) -> tuple[int, int]:
    """The finest exponent with which all codes fit, and the offset."""
    lowest, highest = np.inf, -np.inf
    for k in range(len(order)):
        low, high = _within_reach(lo[order[k, 0]], hi[order[k, 0]], _FAR)
        if low > -np.inf:
            lowest, highest = min(lowest, low), max(highest, low)
        if high < np.inf:
            lowest, highest = min(lowest, high), max(highest, high)
    if lowest > highest:
        return finest, 0
    size = _exponent(max(abs(lowest), abs(highest)), 52)  # offset and codes stay below 2^53
    exponent = max(finest, max(size, _exponent(highest - lowest, 24)))
    while -_quanta_down(-highest, exponent) - _quanta_down(lowest, exponent) > _MOST_SPAN:
        exponent += 1
    return exponent, _quanta_down(lowest, exponent)


@kernel
def _encode(
    lo: Floats,
    hi: Floats,
    cells: tuple[NDArray[np.int32], int],
    exponent: int,
    offset: int,
    far: float,
    out: NDArray[np.uint8],
) -> int:
    """Write codes; gives how many bytes they take. Bounds beyond ``far`` are unbounded."""
    order, starts = cells
    bases, widths = np.zeros(lo.size, np.int32), np.zeros(lo.size, np.int32)
    for k in range(len(order)):
        cell, before = order[k]
        low, high = _within_reach(lo[cell], hi[cell], far)
        if low > -np.inf:
            bases[cell] = _quanta_down(low, exponent) - offset
            widths[cell] = _NO_UPPER
            if high < np.inf:
                above = -_quanta_down(-high, exponent) - offset
                widths[cell] = _BOUNDED + above - bases[cell]
        elif high < np.inf:
            bases[cell] = -_quanta_down(-high, exponent) - offset
            widths[cell] = _NO_LOWER
        else:
            bases[cell] = 0 if before < 0 else bases[before]
            widths[cell] = _UNKNOWN
    place = _pack(bases, order[:starts], out, 0)
    place = _pack(bases, order[starts:], out, place)
    place = _pack(widths, order[:starts], out, place)
    return _pack(widths, order[starts:], out, place)


@kernel
def _encode_all(
    lo: Floats,
    hi: Floats,
    cells: tuple[NDArray[np.int32], int],
    finest: int,
    numbers: NDArray[np.int64],
    out: NDArray[np.uint8],
) -> None:
    """Write the codes of all matrices; exponents, offsets and ends go into the rows of numbers."""
    numbers[2, 0] = 0
    for k in range(len(lo)):
        exponent, offset = _scale(lo[k], hi[k], cells[0], finest)
        size = _encode(lo[k], hi[k], cells, exponent, offset, _FAR, out[numbers[2, k] :])
        numbers[0, k], numbers[1, k], numbers[2, k + 1] = exponent, offset, numbers[2, k] + size


@part
def _pack(
    codes: NDArray[np.int32], order: NDArray[np.int32], out: NDArray[np.uint8], place: int
) -> int:
    """Write differences in groups, each in as many bits as its greatest needs."""
    folded = np.empty(_GROUP, np.int64)
    for begin in range(0, len(order), _GROUP):
        size, bits = min(len(order) - begin, _GROUP), 0
        for k in range(size):
            cell, before = order[begin + k]
            step = np.int64(codes[cell]) - (0 if before < 0 else codes[before])
            step = ((step + _HALF) & (_MODULUS - 1)) - _HALF
            folded[k] = (step << 1) ^ (step >> 63)
            bits |= folded[k]
        width = _bit_length(bits)
        out[place] = width
        place += 1
        held = filled = 0
        for k in range(size):
            held |= folded[k] << filled
            filled += width
            while filled >= 8:
                out[place] = held & 255
                held, filled, place = held >> 8, filled - 8, place + 1
        if filled:
            out[place] = held
            place += 1
    return place


@part
def _bit_length(bits: int) -> int:
    width = 0
    while bits >> width:
        width += 1
    return width


@kernel
def decode_codes(
    data: NDArray[np.uint8],
    within: tuple[int, int],
    cells: tuple[NDArray[np.int32], int],
    scale: tuple[int, int],
    lo: Floats,
    hi: Floats,
) -> tuple[int, int]:
    """Read codes into bounds.

    Args:
        data: Bytes, of which some follow the codes, whatever they are.
        within: Where the codes begin and end.
        cells: As `order_cells` gives them.
        scale: Exponent and offset.
        lo: Lower bounds; what is unknown stays as it is.
        hi: Upper bounds.

    Returns:
        What is wrong, or 0, and where.
    """
    order, starts = cells
    place, behind = within
    exponent, offset = scale
    bases, widths = np.zeros(lo.size, np.int32), np.zeros(lo.size, np.int32)
    fault = 0
    for codes in (bases, widths):
        for part_of in (order[:starts], order[starts:]):
            if not fault:
                fault, place = _unpack(data, (place, behind), part_of, codes)
    if not fault and place != behind:
        fault = _MORE
    quantum = 2.0**exponent
    for k in range(len(order)):
        cell, before = order[k]
        base, kind = offset + np.int64(bases[cell]), widths[cell]
        if kind == _UNKNOWN:
            if not fault and bases[cell] != (0 if before < 0 else bases[before]):
                fault = _NAMED
        elif kind == _NO_LOWER:
            hi[cell] = np.float64(base) * quantum
        else:
            lo[cell] = np.float64(base) * quantum
            if kind != _NO_UPPER:
                hi[cell] = np.float64(base + (kind - _BOUNDED)) * quantum
    return fault, place


@part
def _unpack(
    data: NDArray[np.uint8],
    within: tuple[int, int],
    order: NDArray[np.int32],
    codes: NDArray[np.int32],
) -> tuple[int, int]:
    """Read groups of differences into codes; gives what is wrong, or 0, and where it goes on."""
    place, behind = within
    for begin in range(0, len(order), _GROUP):
        size, bits = min(len(order) - begin, _GROUP), 0
        if place >= behind:
            return _CUT, place
        width = int(data[place])
        if width > _BITS:
            return _WIDE, place
        end = place + 1 + (size * width + 7) // 8
        if end > behind:
            return _CUT, place
        for k in range(size):
            bit = k * width
            word = int(load(data, place + 1 + (bit >> 3), 0, np.uint32))
            folded = word >> (bit & 7) & ((1 << width) - 1)
            bits |= folded
            cell, before = order[begin + k]
            step = (folded >> 1) ^ -(folded & 1)
            codes[cell] = (step + (0 if before < 0 else codes[before])) & (_MODULUS - 1)
        if _bit_length(bits) != width:
            return _LOOSE, place
        if size * width & 7 and data[end - 1] >> (size * width & 7):
            return _FILLING, place
        place = end
    return 0, place
