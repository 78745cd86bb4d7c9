"""The source ``V = Vm·sin(ωt + ψ)·1(t)``, with interval amplitude, frequency and phase."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels import double_double
from eskin.kernels.intrinsics import fma
from eskin.kernels.jit import kernel, part
from eskin.kernels.sine import ABSOLUTE_ERROR, sincospi_of_two, unit_down, unit_up

if TYPE_CHECKING:
    from eskin.kernels.double_double import Two
    from eskin.models.icm.bracket import Indices
    from eskin.models.parameters import Floats

_INVERSE_PI: Final = 0.3183098861837907
_INVERSE_PI_LOW: Final = -1.9678676675182486e-17
_CLOSE: Final = 1e-14  # half turns: a crest this near is taken in, which costs 1e-27 at most
_PHASE_ERROR: Final = 2.0**-98  # of the phase: 1/π has two words
_STEP: Final = 1.0001 * 2.0**-53
_LEAST: Final = 5e-324


@part
def _rest(half_turns: float) -> float:
    """What is left of an angle beyond whole turns, exactly."""
    return fma(-2.0, np.rint(0.5 * half_turns), half_turns)


@part
def _half_turns(frequency: float, time: float, phase: float) -> Two:
    """``2 f t + ψ/π`` in two words, but for whole turns.

    These go from each word before the sum: far words would push near ones out of it.
    """
    turns = 2.0 * frequency * time
    rest = fma(2.0 * frequency, time, -turns)
    high = phase * _INVERSE_PI
    low = fma(phase, _INVERSE_PI, -high) + phase * _INVERSE_PI_LOW
    swing = double_double.sum_of(_rest(turns), _rest(rest))
    return double_double.add(swing, double_double.sum_of(_rest(high), _rest(low)))


@part
def _crest_within(start: Two, width: float, crest: float) -> bool:
    """Whether ``crest + 2n`` lies from an angle in half turns on, within a width, or nearly so."""
    a = _rest(start[0]) + start[1]
    behind = a - _CLOSE - crest
    first = crest + (2.0 if behind > 0.0 else 0.0) - (2.0 if behind <= -2.0 else 0.0)
    return first <= a + width + _CLOSE


@part
def _sine_range(given: Floats, time: float) -> tuple[float, float]:
    """Bounds of ``sin(ωt + ψ)``."""
    f_a, f_b, psi_a, psi_b = given[2], given[3], given[4], given[5]
    first, last = _half_turns(f_a, time, psi_a), _half_turns(f_b, time, psi_b)
    sine, sine_last = sincospi_of_two(first[0], first[1])[0], sincospi_of_two(last[0], last[1])[0]
    slack = max(abs(psi_a), abs(psi_b)) * _PHASE_ERROR
    if ((f_b > 0.0) & (time > 0.0)) | (psi_a != 0.0) | (psi_b != 0.0):
        slack += ABSOLUTE_ERROR  # a product of these may underflow to zero
    least, most = unit_down(min(sine, sine_last)) - slack, unit_up(max(sine, sine_last)) + slack
    width = 2.0 * (f_b - f_a) * time + (psi_b - psi_a) * _INVERSE_PI
    if width > 0.0:
        width *= 1.0 + 1e-15
        most = 1.0 if _crest_within(first, width, 0.5) else most
        least = -1.0 if _crest_within(first, width, -0.5) else least
    return max(least, -1.0), min(most, 1.0)


@kernel
def source_rows(rows: Floats, clock_of: Indices, times: Floats, lo: Floats, hi: Floats) -> None:
    """Bounds of V for rows with bounds of amplitude, frequency and phase."""
    for row in range(rows.shape[0]):
        given = rows[row]
        inf, sup = given[0], given[1]
        for i in range(times.shape[1]):
            time = times[clock_of[row], i]
            if time < 0.0:
                lo[row, i], hi[row, i] = 0.0, 0.0
                continue
            least, most = _sine_range(given, time)
            below = min(min(inf * least, sup * least), min(inf * most, sup * most))
            above = max(max(inf * least, sup * least), max(inf * most, sup * most))
            lo[row, i] = fma(-_STEP, abs(below), below) - _LEAST
            hi[row, i] = fma(_STEP, abs(above), above) + _LEAST
