"""Writes a patch's samples: rounded outward to quanta, differenced, packed into few bits.

``docs/messages.md`` describes the codes; `eskin.wire.frames.sample_codec` is the compiled twin,
equal to the byte.
"""

from math import floor, frexp, ldexp

from eskin_sensor_node.firmware.rounding import INFINITY

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    Cells = list[tuple[int, int]]
    """Cells of a matrix, row after row, each with the cell that predicts it, or -1."""

FINEST = -1000
COARSEST = 930
"""Least and greatest exponent of a quantum: it and its reciprocal are normal floats."""
_FAR = ldexp(1.0, 950)
"""Farther out a side is written as unbounded."""
_GROUP = 64
_MODULUS = 16777216
_HALF = 8388608
"""Codes and their differences have 24 bits: with 7 bits of shift they fit a word of 32."""
_UNKNOWN, _NO_LOWER, _NO_UPPER, _BOUNDED = range(4)
"""Codes of the width matrix; `_BOUNDED` is a width of no quantum."""
_MOST_SPAN = _MODULUS - 1 - _BOUNDED


class Sampling:
    """Which cells of a patch's matrix hold a sample, and in which order they are written.

    Attributes:
        starts: The first sample of each column; the one before it in this list predicts it.
        later: All others, row after row; the one before it in its column predicts it.

    Args:
        rows: Instants.
        columns: Channels.
        first_row: Number of the first row in the node's schedule.
        strides: For each column ``k``: it is sampled in rows whose number is a multiple of ``2^k``.
    """

    __slots__ = ("later", "starts")

    def __init__(
        self, rows: int, columns: int, first_row: int = 0, strides: "Sequence[int]" = ()
    ) -> None:
        self.starts: Cells = []
        self.later: Cells = []
        last = [-1] * columns
        previous = -1
        for row in range(rows):
            for column in range(columns):
                if strides and (first_row + row) & ((1 << strides[column]) - 1):
                    continue
                cell = row * columns + column
                if last[column] < 0:
                    self.starts.append((cell, previous))
                    previous = cell
                else:
                    self.later.append((cell, last[column]))
                last[column] = cell


def finest_exponent(least_width: float) -> int:
    """The exponent of the quantum: at most 1/64 of the least width that a patch states."""
    return min(max(frexp(least_width)[1] - 7, FINEST), COARSEST)


def encode_samples(
    lows: "Sequence[float]", highs: "Sequence[float]", sampling: Sampling, finest: int
) -> "tuple[int, int, bytes]":
    """Encode samples; gives exponent and offset of their quanta, and the codes.

    Args:
        lows: Lower bounds, row after row; ``-inf`` where there is none.
        highs: Upper bounds; ``inf`` where there is none.
        sampling: Which of them are samples.
        finest: From `finest_exponent`; the quantum is coarser only where codes would not fit.
    """
    exponent, offset = _scale(lows, highs, sampling, finest)
    bases = [0] * len(lows)
    widths = [0] * len(lows)
    for cells in (sampling.starts, sampling.later):
        for cell, before in cells:
            lo, hi = _within_reach(lows[cell], highs[cell])
            if lo > -INFINITY:
                bases[cell] = _quanta_down(lo, exponent) - offset
                widths[cell] = _NO_UPPER
                if hi < INFINITY:
                    widths[cell] = _BOUNDED - _quanta_down(-hi, exponent) - offset - bases[cell]
            elif hi < INFINITY:
                bases[cell] = -_quanta_down(-hi, exponent) - offset
                widths[cell] = _NO_LOWER
            else:
                bases[cell] = 0 if before < 0 else bases[before]
                widths[cell] = _UNKNOWN
    out = bytearray()
    for codes in (bases, widths):
        _pack(codes, sampling.starts, out)
        _pack(codes, sampling.later, out)
    return exponent, offset, bytes(out)


def _within_reach(lo: float, hi: float) -> "tuple[float, float]":
    return (
        -INFINITY if lo < -_FAR else min(lo, _FAR),
        INFINITY if hi > _FAR else max(hi, -_FAR),
    )


def _scale(
    lows: "Sequence[float]", highs: "Sequence[float]", sampling: Sampling, finest: int
) -> "tuple[int, int]":
    """The finest exponent with which all codes fit, and the offset."""
    lowest, highest = INFINITY, -INFINITY
    for cells in (sampling.starts, sampling.later):
        for cell, _ in cells:
            lo, hi = _within_reach(lows[cell], highs[cell])
            if lo > -INFINITY:
                lowest, highest = min(lowest, lo), max(highest, lo)
            if hi < INFINITY:
                lowest, highest = min(lowest, hi), max(highest, hi)
    if lowest > highest:
        return finest, 0
    exponent = max(
        finest,
        _exponent(max(abs(lowest), abs(highest)), 52),  # offset and codes stay below 2^53
        _exponent(highest - lowest, 24),
    )
    while -_quanta_down(-highest, exponent) - _quanta_down(lowest, exponent) > _MOST_SPAN:
        exponent += 1
    return exponent, _quanta_down(lowest, exponent)


def _exponent(size: float, bits: int) -> int:
    return frexp(size)[1] - bits if size > 0.0 else FINEST


def _quanta_down(value: float, exponent: int) -> int:
    """The greatest number of quanta that is not above a value."""
    quanta = floor(value * ldexp(1.0, -exponent))
    # The product is exact, or so small that it was rounded to zero.
    return quanta - 1 if quanta * ldexp(1.0, exponent) > value else quanta


def _pack(codes: "Sequence[int]", cells: "Cells", out: bytearray) -> None:
    """Write differences in groups, each in as many bits as its greatest needs."""
    for begin in range(0, len(cells), _GROUP):
        folded = []
        bits = 0
        for cell, before in cells[begin : begin + _GROUP]:
            step = codes[cell] if before < 0 else codes[cell] - codes[before]
            step = (step + _HALF) % _MODULUS - _HALF
            folded.append(2 * step if step >= 0 else -2 * step - 1)
            bits |= folded[-1]
        width = 0
        while bits >> width:
            width += 1
        out.append(width)
        held = filled = 0
        for each in folded:
            held |= each << filled
            filled += width
            while filled >= 8:
                out.append(held & 255)
                held >>= 8
                filled -= 8
        if filled:
            out.append(held)
