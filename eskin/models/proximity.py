"""Metal that comes near a coil: distance, inductance, oscillation (eq. 11 to 13, Fig. 9)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.exponential import exp_down, exp_up
from eskin.kernels.jit import kernel, part
from eskin.kernels.outward_rounding import add_down, add_up, mul_down, mul_up, sub_down, sub_up
from eskin.models.bounds import TINY, TWO_PI, above, below
from eskin.models.broadcasting import BLOCK, block_count, evaluate, load
from eskin.models.parameters import FINITE, not_negative, parameter, positive, require_order
from eskin.models.sinusoid import sine_of_time

if TYPE_CHECKING:
    from eskin.interval import Interval
    from eskin.models.broadcasting import Operands, Results
    from eskin.models.parameters import Bounds, Floats, Parameter

DISTANCE_FREQUENCY: Final = 1.0
"""Frequency in Hz with which the distance of eq. 13 swings."""


@dataclass(frozen=True, slots=True)
class Proximity:
    """A coil's view of a piece of metal.

    Attributes:
        distance: d(t) in m (eq. 13).
        inductance: L(t) in H (eq. 11).
        frequency: f_osc in Hz (eq. 12).
    """

    distance: Interval
    inductance: Interval
    frequency: Interval


@kernel
def _proximity(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((18, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        sine_of_time(work, 12, 14, 16, n)
        lower, upper = out[0][start : start + n], out[1][start : start + n]
        for i in range(n):
            sine = work[16, i]
            reach = work[10, i] if sine >= 0.0 else work[11, i]
            lower[i] = max(add_down(work[8, i], mul_down(reach, sine)), 0.0)
            sine = work[17, i]
            reach = work[11, i] if sine >= 0.0 else work[10, i]
            upper[i] = max(add_up(work[9, i], mul_up(reach, sine)), 0.0)
        _oscillate(work, out, start, n)
    return allowed


@kernel
def _proximity_at(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((10, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        out[0][start : start + n] = work[8, :n]
        out[1][start : start + n] = work[9, :n]
        _oscillate(work, out, start, n)
    return allowed


@part
def _oscillate(work: Floats, out: Results, start: int, n: int) -> None:
    """Inductance and frequency out of the distance, which stands in ``out`` already."""
    d_lower, d_upper = out[0][start : start + n], out[1][start : start + n]
    l_lower, l_upper = out[2][start : start + n], out[3][start : start + n]
    f_lower, f_upper = out[4][start : start + n], out[5][start : start + n]
    for i in range(n):
        near = above(work[3, i] * exp_up(-below(work[4, i] * d_lower[i], 1)), 1) + TINY
        far = below(work[2, i] * exp_down(-above(work[5, i] * d_upper[i], 1)), 1)
        # No exponential exceeds 1, however its bound was rounded: L0 - ΔL holds.
        l_inf = sub_down(work[0, i], min(near, work[3, i]))
        l_sup = sub_up(work[1, i], far)
        l_lower[i], l_upper[i] = l_inf, l_sup
        f_lower[i] = below(1.0 / (TWO_PI * math.sqrt(l_sup * work[7, i])), 5)
        f_upper[i] = above(1.0 / (TWO_PI * math.sqrt(l_inf * work[6, i])), 5)


def _coil(
    base_inductance: Bounds, inductance_change: Bounds, damping: Bounds, capacitance: Bounds
) -> list[Parameter]:
    base = positive("base_inductance", base_inductance)
    change = not_negative("inductance_change", inductance_change)
    require_order(change, base, strict=True)
    return [
        base,
        change,
        not_negative("damping", damping),
        positive("capacitance", capacitance),
    ]


def proximity(
    time: Bounds,
    *,
    base_inductance: Bounds,
    inductance_change: Bounds,
    damping: Bounds,
    capacitance: Bounds,
    mean_distance: Bounds,
    distance_amplitude: Bounds,
    frequency: Bounds = DISTANCE_FREQUENCY,
) -> Proximity:
    """Metal that swings before a coil (eq. 11 to 13), as the paper has it.

    ``d(t) = d₀ + a·sin(2π f t)``, ``L(t) = L₀ - ΔL·e^(-α d(t))``, ``f_osc = 1/(2π √(L(t) C))``.
    Monotone in every parameter: the bounds are exact but for rounding.

    Args:
        time: t in s.
        base_inductance: L₀ in H, > 0; 10 mH in the paper.
        inductance_change: ΔL in H, >= 0 and less than L₀; 5 mH in the paper.
        damping: α in 1/m, >= 0; 10 1/m in the paper.
        capacitance: C in F, > 0; 1 µF in the paper.
        mean_distance: d₀ in m, > 0; 20 mm in the paper.
        distance_amplitude: a in m, >= 0 and not more than d₀; 10 mm in the paper.
        frequency: f in Hz, >= 0; 1 Hz in the paper.

    Returns:
        Distance, inductance and frequency, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    mean = positive("mean_distance", mean_distance)
    amplitude = not_negative("distance_amplitude", distance_amplitude)
    require_order(amplitude, mean, strict=False)
    parameters = [
        *_coil(base_inductance, inductance_change, damping, capacitance),
        mean,
        amplitude,
        not_negative("frequency", frequency),
        parameter("time", time, FINITE),
    ]
    return Proximity(*evaluate(_proximity, parameters, 3))


def proximity_at(
    distance: Bounds,
    *,
    base_inductance: Bounds,
    inductance_change: Bounds,
    damping: Bounds,
    capacitance: Bounds,
) -> Proximity:
    """Metal at a given distance from a coil (eq. 11 and 12), as the paper has it.

    Args:
        distance: d in m, >= 0.
        base_inductance: L₀ in H, > 0.
        inductance_change: ΔL in H, >= 0 and less than L₀.
        damping: α in 1/m, >= 0.
        capacitance: C in F, > 0.

    Returns:
        Distance, inductance and frequency, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [
        *_coil(base_inductance, inductance_change, damping, capacitance),
        not_negative("distance", distance),
    ]
    return Proximity(*evaluate(_proximity_at, parameters, 3))
