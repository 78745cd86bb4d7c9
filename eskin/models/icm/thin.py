"""Bounds of u_c and i1 where all parameters but the amplitude are single numbers: to a few floats.

The response of `eskin.models.icm.response` in its first form, in two words
(`eskin.kernels.double_double`). Its factors are right within ``2**-63`` of themselves (``f``
within ``2**-61`` just above ``s = 0.3466``), products and sums within ``2**-100``.
So ``h`` is within `ERROR` of ``T``, the sum of the sizes of its terms, and only where these all but
cancel do its bounds lie more than a few floats apart. What leaves the range of two words, at times
below `_EARLIEST` and phases beyond 2⁴⁸ rad, is the plain response with its own error.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels import double_double
from eskin.kernels.arctangent import PI
from eskin.kernels.exponential import expm1_excess, expm1_of_two
from eskin.kernels.jit import inlined, kernel, part
from eskin.kernels.logarithm import ONE
from eskin.kernels.outward_rounding import add_down, add_up
from eskin.kernels.trig_double_double import (
    LARGEST,
    reduced,
    reduced_of_half_turns,
    sine_and_cosine,
    sine_excess,
)
from eskin.models.icm.clock import BLOCK, sample_at
from eskin.models.icm.response import ROUNDING, UNDERFLOW, branch, phase_parts, respond

if TYPE_CHECKING:
    from typing import TypeAlias

    from eskin.kernels.double_double import Two
    from eskin.models.icm.bracket import Indices
    from eskin.models.parameters import Floats

    Sample: TypeAlias = tuple[float, Two, Two, Two, bool]
    Amplitude: TypeAlias = tuple[Two, Two, float]
    """Least and greatest, and what underflow may have taken from either."""
    Terms: TypeAlias = tuple[Two, Two, Two, Two, Two, Two]

ERROR: Final = 2.0**-60
"""Bound of the error of ``h``, relative to ``T``."""
_EARLIEST: Final = 1e-150
_AT_ONCE: Final = 0.3465
"""Below it, ``s`` is not reduced before its exponential is taken."""
_SLACK: Final = 1.0 + 1e-9
_LEAST: Final = 8 * 5e-324
_ROWS: Final = 8


@inlined
def sample_in_two_words(frequency: float, time: float) -> Sample:
    """Time, ``sin a``, ``sin a - a`` (later ``sin a``), ``1 - cos a``, and whether ``a <= 1``."""
    turns = double_double.product_of(frequency, time)
    half_sine, half_cosine = sine_and_cosine(reduced_of_half_turns(turns[0], turns[1]))
    sine = double_double.scaled(double_double.mul(half_sine, half_cosine), 2.0)
    versine = double_double.scaled(double_double.mul(half_sine, half_sine), 2.0)
    a = double_double.scaled(double_double.mul(turns, PI), 2.0)
    early = a[0] <= 1.0
    near = (a[0] if early else 0.0), (a[1] if early else 0.0)
    square = double_double.mul(near, near)
    short = double_double.mul(near, double_double.mul(square, sine_excess(square)))
    less = (short[0] if early else sine[0]), (short[1] if early else sine[1])
    return time, sine, less, versine, early


@inlined
def decay_in_two_words(s: Two) -> tuple[Two, Two]:
    """``1 - e**-s`` and ``e**-s - 1 + s`` for ``s >= 0``."""
    less = expm1_of_two((-s[0], -s[1]))
    at_once = s[0] < _AT_ONCE
    near = (-s[0] if at_once else 0.0), (-s[1] if at_once else 0.0)
    small = double_double.mul(double_double.mul(near, near), expm1_excess(near))
    great = double_double.add(s, less)
    lag = (small[0] if at_once else great[0]), (small[1] if at_once else great[1])
    return (-less[0], -less[1]), lag


@inlined
def branch_in_two_words(frequency: float, over: Two, under: Two) -> tuple[Two, Two]:
    """``1/(1 + x²)`` and ``x/(1 + x²)`` for ``x = ωτ``, ``τ = over/under``."""
    x = double_double.mul(double_double.div(double_double.scaled(over, 2.0 * frequency), under), PI)
    slow = x[0] > 1.0
    z = double_double.div(ONE, x) if slow else x
    square = double_double.mul(z, z)
    below = double_double.add(ONE, square)
    first, second = double_double.div(ONE, below), double_double.div(square, below)
    return (second if slow else first), double_double.div(z, below)


@inlined
def respond_in_two_words(terms: Terms, sample: Sample) -> tuple[Two, float]:
    """``h`` and the sum of sizes ``T``.

    Args:
        terms: sin ψ, cos ψ, c0, c1, and τ as a fraction, over and under.
        sample: Of `sample_in_two_words`.
    """
    sine_phase, cosine_phase, c0, c1, over, under = terms
    t, sine, short, versine, early = sample
    gone, lag = decay_in_two_words(double_double.div(double_double.scaled(under, t), over))
    rest = (lag[0] if early else -gone[0]), (lag[1] if early else -gone[1])
    swing = double_double.sub(gone, versine)
    both = double_double.add(versine, rest)
    in_phase = double_double.add(double_double.mul(c1, sine), double_double.mul(c0, swing))
    lagging = double_double.add(double_double.mul(c0, short), double_double.mul(c1, both))
    h = double_double.add(
        double_double.mul(sine_phase, in_phase), double_double.mul(cosine_phase, lagging)
    )
    size = abs(sine_phase[0]) * (c1[0] * abs(sine[0]) + c0[0] * (gone[0] + versine[0]))
    size += abs(cosine_phase[0]) * (c0[0] * abs(short[0]) + c1[0] * (versine[0] + abs(rest[0])))
    return h, size * _SLACK


@part
def _fill(frequency: float, times: Floats, table: Floats) -> None:
    for i in range(times.size):
        time, sine, short, versine, early = sample_in_two_words(frequency, max(times[i], 0.0))
        table[0, i], table[1, i], table[2, i], table[3, i] = time, sine[0], sine[1], short[0]
        table[4, i], table[5, i], table[6, i] = short[1], versine[0], versine[1]
        table[7, i] = 1.0 if early else 0.0


@part
def _sample_of(table: Floats, i: int) -> Sample:
    early = table[7, i] != 0.0
    sine, short = (table[1, i], table[2, i]), (table[3, i], table[4, i])
    return table[0, i], sine, short, (table[5, i], table[6, i]), early


@inlined
def _bounds(h: Two, error: float, amplitude: Amplitude) -> tuple[float, float]:
    """Least and greatest product with an amplitude, rounded outward once."""
    least, most, lost = amplitude
    one, other = double_double.mul(h, least), double_double.mul(h, most)
    spare = lost * (abs(h[0]) + error) + _LEAST
    one_error, other_error = error * abs(least[0]) + spare, error * abs(most[0]) + spare
    lo = min(add_down(one[0], one[1] - one_error), add_down(other[0], other[1] - other_error))
    hi = max(add_up(one[0], one[1] + one_error), add_up(other[0], other[1] + other_error))
    return lo, hi


@part
def _evaluate(
    frequency: float, phase: float, over: Two, under: Two, amplitude: Amplitude,
    table: Floats, lo: Floats, hi: Floats,
) -> None:  # fmt: skip
    """Bounds over a row: first all that two words can do, then what they cannot."""
    far = abs(phase) > LARGEST
    sine_phase, cosine_phase = sine_and_cosine(reduced(0.0 if far else phase))
    c0, c1 = branch_in_two_words(frequency, over, under)
    terms = sine_phase, cosine_phase, c0, c1, over, under
    for i in range(lo.size):
        h, size = respond_in_two_words(terms, _sample_of(table, i))
        error = ERROR * size + UNDERFLOW * _SLACK
        low, high = _bounds(h, error, amplitude)
        silent = table[0, i] == 0.0
        lo[i], hi[i] = (0.0 if silent else low), (0.0 if silent else high)
    for i in range(lo.size):
        t = table[0, i]
        if (t > 0.0) & (far | (t < _EARLIEST)):
            of = branch(frequency, over[0] / under[0])
            h_plain, _, size, _, _ = respond(of, phase_parts(phase), sample_at(frequency, t))
            error = ROUNDING * size + UNDERFLOW * _SLACK
            lo[i], hi[i] = _bounds((h_plain, 0.0), error, amplitude)


@part
def _rows(
    rows: Floats,
    clock_of: Indices,
    times: Floats,
    lo: Floats,
    hi: Floats,
    coil: bool,  # noqa: FBT001
) -> None:
    table = np.empty((_ROWS, BLOCK))
    for start in range(0, times.shape[1], BLOCK):
        stop = min(start + BLOCK, times.shape[1])
        for row in range(rows.shape[0]):
            given, clock = rows[row], clock_of[row]
            if row == 0 or given[2] != rows[row - 1, 2] or clock != clock_of[row - 1]:
                _fill(given[2], times[clock, start:stop], table)
            under = (given[6], 0.0) if coil else ONE
            over = (given[8], 0.0) if coil else double_double.product_of(given[6], given[8])
            least = double_double.div((given[0], 0.0), under)
            most = double_double.div((given[1], 0.0), under)
            silent = (given[0] == 0.0) & (given[1] == 0.0)
            amplitude = least, most, (0.0 if silent else _LEAST / under[0])
            place = lo[row, start:stop], hi[row, start:stop]
            _evaluate(given[2], given[4], over, under, amplitude, table, place[0], place[1])


@kernel
def thin_voltage_rows(
    rows: Floats, clock_of: Indices, times: Floats, lo: Floats, hi: Floats
) -> None:
    """Bounds of u_c for rows whose parameters are thin but the amplitude; see `voltage_rows`."""
    _rows(rows, clock_of, times, lo, hi, False)  # noqa: FBT003 - compiled code knows no keywords


@kernel
def thin_current_rows(
    rows: Floats, clock_of: Indices, times: Floats, lo: Floats, hi: Floats
) -> None:
    """Bounds of i1 for rows whose parameters are thin but the amplitude; see `current_rows`."""
    _rows(rows, clock_of, times, lo, hi, True)  # noqa: FBT003 - compiled code knows no keywords
