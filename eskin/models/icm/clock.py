"""What depends on time and frequency alone: the source's phase at each sample.

One table a row of times, so that a thousand taxels share one evaluation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.intrinsics import fma
from eskin.kernels.jit import inlined, part
from eskin.kernels.sine import sincospi_of_product, sincospi_of_two

if TYPE_CHECKING:
    from typing import TypeAlias

    from eskin.models.parameters import Floats

    Sample: TypeAlias = tuple[float, float, float, float, float, bool]

TIME: Final = 0
"""Row of the table: time since the source was switched on, s, never negative."""
SINE: Final = 1
"""Row: ``sin a``, with ``a = ωt``."""
SHORT_SINE: Final = 2
"""Row: ``sin a - a`` where ``a <= 1``, else ``sin a``."""
VERSINE: Final = 3
"""Row: ``1 - cos a``."""
REACH: Final = 4
"""Row: ``min(a, 1)``, an upper bound of ``|sin|`` up to ``a``."""
EARLY: Final = 5
"""Row: 1 where ``a <= 1``, else 0."""
ROWS: Final = 6
BLOCK: Final = 2048
"""Times that a kernel works on at once; a multiple of 8. Its tables stay in the cache."""

PI: Final = 3.141592653589793
PI_LOW: Final = 1.2246467991473532e-16
_INVERSE_PI: Final = 0.3183098861837907
_INVERSE_PI_LOW: Final = -1.9678676675182486e-17


@part
def _sine_less_angle(a: float) -> float:
    """``sin a - a`` for ``0 <= a <= 1``: Taylor to ``a**19``, relative error below ``5 u``."""
    t = a * a
    tail = fma(t, -8.220635246624329e-18, 2.8114572543455206e-15)
    tail = fma(t, tail, -7.647163731819816e-13)
    tail = fma(t, tail, 1.6059043836821613e-10)
    tail = fma(t, tail, -2.505210838544172e-08)
    tail = fma(t, tail, 2.7557319223985893e-06)
    tail = fma(t, tail, -0.0001984126984126984)
    tail = fma(t, tail, 0.008333333333333333)
    tail = fma(t, tail, -0.16666666666666666)
    return a * t * tail


@part
def phase_of(phase: float) -> tuple[float, float]:
    """Sine and cosine of a phase in rad.

    Its error: 1.7 u of the result, and ``2**-100`` of the phase, from 1/π of two words.
    """
    high = phase * _INVERSE_PI
    low = fma(phase, _INVERSE_PI, -high) + phase * _INVERSE_PI_LOW
    return sincospi_of_two(high, low)


@part
def sample_at(frequency: float, time: float) -> Sample:
    """What the clock shows at one time; before time 0 it is as at time 0."""
    t = max(time, 0.0)
    half_sine, half_cosine = sincospi_of_product(frequency, t)
    turns = 2.0 * frequency * t
    rest = fma(2.0 * frequency, t, -turns)
    a = fma(turns, PI, fma(turns, PI_LOW, rest * PI))
    early = a <= 1.0
    sine = 2.0 * half_sine * half_cosine
    reach = min(a, 1.0)
    short_sine = _sine_less_angle(reach) if early else sine
    return t, sine, short_sine, 2.0 * half_sine * half_sine, reach, early


@part
def fill_clock(frequency: float, times: Floats, table: Floats) -> None:
    """Fill the first columns of a table of `ROWS` rows, one for each time."""
    for i in range(times.size):
        now = sample_at(frequency, times[i])
        table[TIME, i], table[SINE, i], table[SHORT_SINE, i] = now[0], now[1], now[2]
        table[VERSINE, i], table[REACH, i], table[EARLY, i] = now[3], now[4], 1.0 if now[5] else 0.0


@inlined
def sample_of(table: Floats, i: int) -> Sample:
    """One column of the table; the last as a truth value."""
    early = table[EARLY, i] != 0.0
    sines = table[SINE, i], table[SHORT_SINE, i], table[VERSINE, i]
    return table[TIME, i], sines[0], sines[1], sines[2], table[REACH, i], early


@inlined
def late_sample_of(table: Floats, i: int) -> Sample:
    """One column of the table where ``a > 1``: the compiler drops what is for small times."""
    sine = table[SINE, i]
    return table[TIME, i], sine, sine, table[VERSINE, i], 1.0, False


@part
def late_from(table: Floats, count: int) -> np.uint64:
    """From which column on ``a > 1``: a multiple of 8, or ``count``.

    Unsigned, so that the compiler sees no index from the end, and makes vector instructions.
    """
    last = 0
    for i in range(count):
        last = i + 1 if table[EARLY, i] != 0.0 else last
    return np.uint64(min((last + 7) // 8 * 8, count))
