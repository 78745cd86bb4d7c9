"""Blocks and peaks, compiled: byte for byte what the firmware writes.

The twin of `firmware.encoding` and `firmware.message_writer`: the emulator writes with it, for one
and for thousands at once. A test holds it against the firmware on every profile and encoding.
"""

from __future__ import annotations

from math import ceil, floor, frexp, inf, ldexp
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from eskin.kernels.jit import part
from eskin_sensor_node.firmware.encoding import F32, F64, TAGS
from eskin_sensor_node.firmware.message_writer import BLOCK, PEAK
from eskin_sensor_node.machine.cbor import (
    BYTES,
    TAG,
    Scratch,
    begun,
    copied,
    head,
    integer,
    pair,
    real,
    reals,
)
from eskin_sensor_node.machine.compilation import compiled_inversion

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_sensor_node.machine.cbor import Bytes

_up: Final = compiled_inversion().up
_down: Final = compiled_inversion().down
_UNBOUNDED: Final = 65535
_MOST_CODE: Final = 65534
_FAR: Final = ldexp(1.0, 1000)
_MOST_F32: Final = 16777215 * ldexp(1.0, 104)
_FINE: Final = 1020
"""Up to this exponent of ``q16`` scaling is a product with a power of two that a float has."""


class Channel(NamedTuple):
    """A message's channel.

    Attributes:
        names: Name and unit, as they stand in the message.
        dt: Sampling period in ns.
        coverage: Of one sample.
    """

    names: Bytes
    dt: int
    coverage: float


class Span(NamedTuple):
    """A stretch of time, in ns.

    Attributes:
        ticks: Its begin.
        earliest: Lower bound of the begin.
        latest: Upper bound of the begin; in a peak, of the end.
    """

    ticks: int
    earliest: int
    latest: int


@part
def scale(lows: Floats, highs: Floats) -> tuple[int, int]:
    """Exponent and offset of ``q16``'s finest scale that reaches all finite bounds."""
    lowest, highest = inf, -inf
    for k in range(lows.size):
        lo, hi = max(lows[k], -inf), highs[k]
        if lo >= -_FAR:
            lo = min(lo, _FAR)
            lowest, highest = min(lowest, lo), max(highest, lo)
        if hi <= _FAR:
            hi = max(hi, -_FAR)
            lowest, highest = min(lowest, hi), max(highest, hi)
    if lowest > highest:
        return 0, 0
    exponent = max(frexp(max(abs(lowest), abs(highest)))[1] - 53, -1074)
    first = floor(ldexp(lowest, -exponent)) - 1
    while ceil(ldexp(highest, -exponent)) + 1 - first > _MOST_CODE:
        exponent += 1
        first = floor(ldexp(lowest, -exponent)) - 1
    return exponent, first


@part
def write_q16(
    out: Bytes, lo_at: int, hi_at: int, lows: Floats, highs: Floats, exponent: int, offset: int
) -> tuple[float, float, float]:
    """Write bounds; gives the lowest and the highest as written, and the widening."""
    lowest, highest, widening = inf, -inf, 0.0
    fine = -_FINE < exponent < _FINE
    shrink, grow = ldexp(1.0, -exponent) if fine else 0.0, ldexp(1.0, exponent) if fine else 0.0
    for k in range(lows.size):
        low, high, below, above = -inf, inf, _UNBOUNDED, _UNBOUNDED
        if lows[k] >= -_FAR:
            lo = min(lows[k], _FAR)
            below = floor(lo * shrink if fine else ldexp(lo, -exponent)) - offset
            low = (below + offset) * grow if fine else ldexp(float(below + offset), exponent)
            if low > lo:
                below -= 1
                low = ldexp(float(below + offset), exponent)
            widening = max(widening, lows[k] - low)
        if highs[k] <= _FAR:
            hi = max(highs[k], -_FAR)
            above = ceil(hi * shrink if fine else ldexp(hi, -exponent)) - offset
            high = (above + offset) * grow if fine else ldexp(float(above + offset), exponent)
            if high < hi:
                above += 1
                high = ldexp(float(above + offset), exponent)
            widening = max(widening, high - highs[k])
        out[lo_at + 2 * k], out[lo_at + 2 * k + 1] = below & 0xFF, below >> 8
        out[hi_at + 2 * k], out[hi_at + 2 * k + 1] = above & 0xFF, above >> 8
        lowest, highest = min(lowest, low), max(highest, high)
    return lowest, highest, widening


@part
def single_up(value: float, room: Scratch) -> float:
    """The least binary32 that is not below a value."""
    if value > _MOST_F32:
        return inf
    if value < -_MOST_F32:
        return -inf if value == -inf else -_MOST_F32
    room.single[0] = value
    if room.single[0] < value:
        bits = room.single_bits[0]
        if room.single[0] == 0.0:
            room.single_bits[0] = 1
        else:
            room.single_bits[0] = bits + (1 if bits >= 0 else -1)
    return float(room.single[0])


@part
def put(out: Bytes, at: int, value: float, encoding: int, room: Scratch) -> None:
    """A float, little endian, in the width of the encoding."""
    if encoding == F64:
        room.double[0] = value
        for k in range(8):
            out[at + k] = (room.bits[0] >> (8 * k)) & 0xFF
    else:
        room.single[0] = value
        for k in range(4):
            out[at + k] = (room.single_bits[0] >> (8 * k)) & 0xFF


@part
def write_floats(
    out: Bytes,
    lo_at: int,
    hi_at: int,
    lows: Floats,
    highs: Floats,
    encoding: int,
    room: Scratch,
) -> tuple[float, float, float]:
    """Write bounds as ``f64`` or ``f32``; gives what `write_q16` gives."""
    lowest, highest, widening = inf, -inf, 0.0
    size = 8 if encoding == F64 else 4
    for k in range(lows.size):
        low, high = lows[k], highs[k]
        if encoding == F32:
            low, high = -single_up(-low, room), single_up(high, room)
        put(out, lo_at + size * k, low, encoding, room)
        put(out, hi_at + size * k, high, encoding, room)
        lowest, highest = min(lowest, low), max(highest, high)
        if low > -inf:
            widening = max(widening, lows[k] - low)
        if high < inf:
            widening = max(widening, high - highs[k])
    return lowest, highest, widening


@part
def block(
    out: Bytes,
    at: int,
    boot: int,
    sequence: int,
    channel: Channel,
    time: Span,
    encoding: int,
    lows: Floats,
    highs: Floats,
    room: Scratch,
) -> int:
    """The samples of one channel."""
    n, floats = lows.size, encoding in (F64, F32)
    at = begun(out, at, BLOCK, 15 if floats else 17, boot, sequence)
    at = copied(out, at, channel.names)
    at = integer(out, integer(out, at, 6), time.ticks)
    at = pair(out, at, 7, time.earliest, time.latest)
    at = integer(out, integer(out, at, 8), channel.dt)
    at = integer(out, integer(out, at, 9), n)
    at = real(out, integer(out, at, 10), channel.coverage, room)
    at = integer(out, integer(out, at, 11), encoding)
    size = n * (8 if encoding == F64 else 4 if encoding == F32 else 2)
    lo_at = head(out, head(out, integer(out, at, 12), TAG, TAGS[encoding]), BYTES, size)
    at = lo_at + size
    hi_at = head(out, head(out, integer(out, at, 13), TAG, TAGS[encoding]), BYTES, size)
    at = hi_at + size
    exponent = offset = 0
    if floats:
        lowest, highest, widening = write_floats(out, lo_at, hi_at, lows, highs, encoding, room)
    else:
        exponent, offset = scale(lows, highs)
        lowest, highest, widening = write_q16(out, lo_at, hi_at, lows, highs, exponent, offset)
    at = reals(out, at, 14, lowest, highest, room)
    if not floats:
        at = integer(out, integer(out, at, 15), exponent)
        at = integer(out, integer(out, at, 16), offset)
    return real(out, integer(out, at, 17), _up(widening) if widening > 0.0 else 0.0, room)


@part
def peak(
    out: Bytes,
    at: int,
    boot: int,
    sequence: int,
    channel: Channel,
    time: Span,
    event: Any,
    samples: int,
    room: Scratch,
) -> int:
    """A peak, or a region of possible ones.

    ``event`` is a row of `eskin.peaks.table.EVENT`; it holds if so many ``samples`` do.
    """
    at = begun(out, at, PEAK, 11, boot, sequence)
    at = copied(out, at, channel.names)
    at = pair(out, at, 6, time.earliest, time.latest)
    at = integer(out, integer(out, at, 7), event.verdict)
    at = pair(out, at, 8, event.fewest, event.most)
    at = reals(out, at, 9, event.height_inf, event.height_sup, room)
    at = reals(out, at, 10, event.prominence_inf, event.prominence_sup, room)
    coverage = channel.coverage
    if coverage != 1.0:
        coverage = max(0.0, _down(1.0 - _up(samples * (1.0 - coverage))))
    return real(out, integer(out, at, 11), coverage, room)
