"""How a block's bounds are written: ``f64``, ``f32`` or ``q16``, each rounded outward.

``q16`` is ``(offset + code)·2^exponent`` with integer offset and code, so that every decoder gets
exactly the same binary64; code 65535 is an unbounded side. See `eskin.wire.messages.encoding`.
"""

import struct
from math import ceil, floor, frexp, ldexp

from eskin_sensor_node.firmware.rounding import INFINITY

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

F64 = 0
F32 = 1
Q16 = 2
TAGS = (86, 85, 69)
"""RFC 8746 tag of each encoding's arrays."""
_UNBOUNDED = 65535
_MOST_CODE = 65534
_FAR = ldexp(1.0, 1000)
"""Farther out, ``q16`` calls a side unbounded: its scale would leave the range of binary64."""
_MOST_F32 = 16777215 * ldexp(1.0, 104)


class Written:
    """What an encoding made of a block's bounds.

    Attributes:
        lo: Bytes of the lower bounds.
        hi: Bytes of the upper bounds.
        lowest: The least of the lower bounds, as written.
        highest: The greatest of the upper bounds, as written.
        widening: How far a bound was moved outward at most, before its own rounding.
        exponent: Of ``q16``.
        offset: Of ``q16``.
    """

    __slots__ = ("exponent", "hi", "highest", "lo", "lowest", "offset", "widening")

    def __init__(self, size: int) -> None:
        self.lo = bytearray(size)
        self.hi = bytearray(size)
        self.lowest = INFINITY
        self.highest = -INFINITY
        self.widening = 0.0
        self.exponent = 0
        self.offset = 0

    def note(self, lo: float, hi: float, low: float, high: float) -> None:
        """Take in what ``[lo, hi]`` became."""
        self.lowest = min(self.lowest, low)
        self.highest = max(self.highest, high)
        if lo - low > self.widening and low > -INFINITY:
            self.widening = lo - low
        if high - hi > self.widening and high < INFINITY:
            self.widening = high - hi


def write(encoding: int, lows: "Sequence[float]", highs: "Sequence[float]", n: int) -> Written:
    """Write n bounds."""
    if encoding == Q16:
        return write_q16(lows, highs, n)
    written = Written(n * (8 if encoding == F64 else 4))
    for k in range(n):
        if encoding == F64:
            low, high = lows[k], highs[k]
            struct.pack_into("<d", written.lo, 8 * k, low)
            struct.pack_into("<d", written.hi, 8 * k, high)
        else:
            low = -single_up(-lows[k], written.lo, 4 * k, negate=True)
            high = single_up(highs[k], written.hi, 4 * k, negate=False)
        written.note(lows[k], highs[k], low, high)
    return written


def single_up(value: float, buffer: bytearray, offset: int, *, negate: bool) -> float:
    """Write the least binary32 that is not below a value, or its negative; give the former."""
    if value > _MOST_F32:
        single = INFINITY
    elif value < -_MOST_F32:
        single = -INFINITY if value == -INFINITY else -_MOST_F32
    else:
        (single,) = struct.unpack("<f", struct.pack("<f", value))
        if single < value:
            (bits,) = struct.unpack("<i", struct.pack("<f", single))
            # Positive patterns grow with the number, negative ones with its size.
            bits = 1 if single == 0.0 else bits + (1 if bits >= 0 else -1)
            (single,) = struct.unpack("<f", struct.pack("<i", bits))
    struct.pack_into("<f", buffer, offset, -single if negate else single)
    return single


def write_q16(lows: "Sequence[float]", highs: "Sequence[float]", n: int) -> Written:
    """Write n bounds on the finest scale that reaches all finite ones."""
    written = Written(2 * n)
    exponent, offset = scale(lows, highs, n)
    written.exponent, written.offset = exponent, offset
    for k in range(n):
        lo, hi = within_reach(lows[k], highs[k])
        low, high = -INFINITY, INFINITY
        below = above = _UNBOUNDED
        if lo - lo == 0.0:
            below = floor(ldexp(lo, -exponent)) - offset
            low = ldexp(float(below + offset), exponent)
            if low > lo:  # a subnormal may have been rounded up to zero
                below -= 1
                low = ldexp(float(below + offset), exponent)
        if hi - hi == 0.0:
            above = ceil(ldexp(hi, -exponent)) - offset
            high = ldexp(float(above + offset), exponent)
            if high < hi:
                above += 1
                high = ldexp(float(above + offset), exponent)
        struct.pack_into("<H", written.lo, 2 * k, below)
        struct.pack_into("<H", written.hi, 2 * k, above)
        written.note(lows[k], highs[k], low, high)
    return written


def within_reach(lo: float, hi: float) -> "tuple[float, float]":
    """The tightest bounds around ``[lo, hi]`` that ``q16`` has."""
    return (
        -INFINITY if lo < -_FAR else min(lo, _FAR),
        INFINITY if hi > _FAR else max(hi, -_FAR),
    )


def scale(lows: "Sequence[float]", highs: "Sequence[float]", n: int) -> "tuple[int, int]":
    """Exponent and offset of the finest scale that reaches all finite bounds."""
    lowest, highest = INFINITY, -INFINITY
    for k in range(n):
        for value in within_reach(lows[k], highs[k]):
            if value - value == 0.0:
                lowest, highest = min(lowest, value), max(highest, value)
    if lowest > highest:
        return 0, 0
    exponent = max(frexp(max(abs(lowest), abs(highest)))[1] - 53, -1074)
    while _span(lowest, highest, exponent) > _MOST_CODE:
        exponent += 1
    return exponent, floor(ldexp(lowest, -exponent)) - 1


def _span(lowest: float, highest: float, exponent: int) -> int:
    first = floor(ldexp(lowest, -exponent)) - 1
    return ceil(ldexp(highest, -exponent)) + 1 - first
