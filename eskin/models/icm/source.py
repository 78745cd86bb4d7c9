"""The source ``V = Vm·sin(ωt + ψ)·1(t)``, with interval amplitude, frequency and phase."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.compiled import kernel, part
from eskin.kernels.instructions import fma
from eskin.kernels.sine import sincospi_of_two, unit_down, unit_up

if TYPE_CHECKING:
    from eskin.models.icm.bracket import Indices
    from eskin.models.parameters import Floats

_INVERSE_PI: Final = 0.3183098861837907
_INVERSE_PI_LOW: Final = -1.9678676675182486e-17
_CLOSE: Final = 1e-14  # half turns: a crest this near is taken in, which costs 1e-27 at most
_PHASE_ERROR: Final = 2.0**-98  # of the phase: 1/π has two words
_STEP: Final = 1.0001 * 2.0**-53
_MANY: Final = 2.0**40  # half turns
_LEAST: Final = 5e-324
_UNDERFLOW: Final = 16 * _LEAST  # of the sine: a subnormal phase divided by π has lost bits


@part
def _half_turns(frequency: float, time: float, phase: float) -> tuple[float, float]:
    """``2 f t + ψ/π`` in two words; of many turns, less an even number."""
    turns = 2.0 * frequency * time
    rest = fma(2.0 * frequency, time, -turns)
    if turns > _MANY:  # two words would not hold all of it and the phase
        turns = fma(-2.0, np.rint(0.5 * turns), turns)
        rest = fma(-2.0, np.rint(0.5 * rest), rest)
    high = phase * _INVERSE_PI
    low = fma(phase, _INVERSE_PI, -high) + phase * _INVERSE_PI_LOW
    total = turns + high
    part_of = total - turns
    carry = (turns - (total - part_of)) + (high - part_of)
    return total, carry + (rest + low)


@part
def _crest_between(high_a: float, low_a: float, high_b: float, low_b: float, crest: float) -> bool:
    """Whether ``crest + 2n`` lies between two angles in half turns, or as good as."""
    shift: float = 2.0 * np.rint(0.5 * high_a)  # an integer would overflow
    a, b = (high_a - shift) + low_a, (high_b - shift) + low_b
    behind = a - _CLOSE - crest
    first = crest + (2.0 if behind > 0.0 else 0.0) - (2.0 if behind <= -2.0 else 0.0)
    return bool(first <= b + _CLOSE)


@kernel
def source_rows(rows: Floats, clock_of: Indices, times: Floats, lo: Floats, hi: Floats) -> None:
    """Bounds of V for rows with bounds of amplitude, frequency and phase."""
    for row in range(rows.shape[0]):
        given = rows[row]
        slack = max(abs(given[4]), abs(given[5])) * _PHASE_ERROR + _UNDERFLOW
        many_phases = max(abs(given[4]), abs(given[5])) > _MANY
        for i in range(times.shape[1]):
            time = times[clock_of[row], i]
            if time < 0.0:
                lo[row, i], hi[row, i] = 0.0, 0.0
                continue
            high_a, low_a = _half_turns(given[2], time, given[4])
            high_b, low_b = _half_turns(given[3], time, given[5])
            first, last = sincospi_of_two(high_a, low_a)[0], sincospi_of_two(high_b, low_b)[0]
            error = slack + min(2.0 * given[3] * time, 2.0**50) * 2.0**-100
            least = max(unit_down(min(first, last)) - error, -1.0)
            most = min(unit_up(max(first, last)) + error, 1.0)
            thick_f, thick = given[2] != given[3], (high_a != high_b) | (low_a != low_b)
            if (thick_f & (2.0 * given[3] * time > _MANY)) | (thick & many_phases):
                least, most = -1.0, 1.0  # which crests are met is not known to one float
            elif thick:
                if _crest_between(high_a, low_a, high_b, low_b, 0.5):
                    most = 1.0
                if _crest_between(high_a, low_a, high_b, low_b, -0.5):
                    least = -1.0
            inf, sup = given[0], given[1]
            below = min(min(inf * least, sup * least), min(inf * most, sup * most))
            above = max(max(inf * least, sup * least), max(inf * most, sup * most))
            lo[row, i] = fma(-_STEP, abs(below), below) - _LEAST
            hi[row, i] = fma(_STEP, abs(above), above) + _LEAST
