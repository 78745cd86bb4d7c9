"""A coil with uncertain inductance: oscillation, impedance, current (eq. 14)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.kernels.outward_rounding import sub_down, sub_up
from eskin.models.bounds import TWO_PI, above, below
from eskin.models.broadcasting import BLOCK, block_count, evaluate, load
from eskin.models.coil import angle_up
from eskin.models.parameters import FINITE, not_negative, parameter, positive
from eskin.models.sinusoid import mixed_down, mixed_up, raise_sine

if TYPE_CHECKING:
    from eskin.interval import Interval
    from eskin.models.broadcasting import Operands, Results
    from eskin.models.parameters import Bounds, Floats


@dataclass(frozen=True, slots=True)
class Resonance:
    """A coil in series with a capacitor at a harmonic source.

    Attributes:
        inductance: L(t) in H.
        oscillation: f_osc = 1/(2π √(L C)) in Hz (eq. 14).
        reactance: X = ωL - 1/(ωC) in Ω.
        impedance: Size of R + jX in Ω; its lower bound is R where X may be 0, at resonance.
        current: Amplitude of V/(R + jX) in A.
        phase: Lead of the current over the voltage, -atan(X/R), in rad.
    """

    inductance: Interval
    oscillation: Interval
    reactance: Interval
    impedance: Interval
    current: Interval
    phase: Interval


@kernel
def _resonance(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((20, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        raise_sine(work, 12, 14, 16, n)
        l_lower, l_upper = out[0][start : start + n], out[1][start : start + n]
        f_lower, f_upper = out[2][start : start + n], out[3][start : start + n]
        for i in range(n):
            l_inf = mixed_down(work, 16, i, work[8, i], work[10, i])
            l_sup = mixed_up(work, 16, i, work[9, i], work[11, i])
            l_lower[i], l_upper[i] = l_inf, l_sup
            f_lower[i] = below(1.0 / (TWO_PI * math.sqrt(l_sup * work[5, i])), 5)
            f_upper[i] = above(1.0 / (TWO_PI * math.sqrt(l_inf * work[4, i])), 5)
        _react(work, out, start, n)
        _conduct(work, out, start, n)
    return allowed


@part
def _react(work: Floats, out: Results, start: int, n: int) -> None:
    """Reactance out of the inductance, which stands in ``out`` already."""
    l_lower, l_upper = out[0][start : start + n], out[1][start : start + n]
    x_lower, x_upper = out[4][start : start + n], out[5][start : start + n]
    for i in range(n):
        w_inf, w_sup = TWO_PI * work[6, i], TWO_PI * work[7, i]
        x_lower[i] = sub_down(below(w_inf * l_lower[i], 3), above(1.0 / (w_inf * work[4, i]), 4))
        x_upper[i] = sub_up(above(w_sup * l_upper[i], 3), below(1.0 / (w_sup * work[5, i]), 4))


@part
def _conduct(work: Floats, out: Results, start: int, n: int) -> None:
    """Impedance, current and phase out of the reactance."""
    x_lower, x_upper = out[4][start : start + n], out[5][start : start + n]
    z_lower, z_upper = out[6][start : start + n], out[7][start : start + n]
    i_lower, i_upper = out[8][start : start + n], out[9][start : start + n]
    p_lower, p_upper = out[10][start : start + n], out[11][start : start + n]
    for i in range(n):
        x_inf, x_sup, r_inf, r_sup = x_lower[i], x_upper[i], work[2, i], work[3, i]
        least = max(x_inf, -x_sup, 0.0)
        most = max(abs(x_inf), abs(x_sup))
        z_inf = max(below(math.sqrt(r_inf * r_inf + least * least), 3), r_inf)
        z_sup = above(math.sqrt(r_sup * r_sup + most * most), 3)
        z_lower[i], z_upper[i] = z_inf, z_sup
        i_lower[i] = below(work[0, i] / z_sup, 1)
        i_upper[i] = above(work[1, i] / z_inf, 1)
        p_upper[i] = angle_up(slope_up(-x_inf, r_inf, r_sup))
        p_lower[i] = -angle_up(slope_up(x_sup, r_inf, r_sup))


@part
def slope_up(x: float, r_inf: float, r_sup: float) -> float:
    """Upper bound of ``x/r`` over ``r > 0``."""
    return above(x / r_inf, 1) if x >= 0.0 else -below(-x / r_sup, 1)


def resonance(
    time: Bounds,
    *,
    voltage: Bounds,
    resistance: Bounds,
    capacitance: Bounds,
    source_frequency: Bounds,
    minimum_inductance: Bounds,
    maximum_inductance: Bounds,
    frequency: Bounds,
) -> Resonance:
    """A coil whose inductance swings between two bounds (eq. 14), as the paper has it.

    ``L(t) = Lmin + (Lmax - Lmin)·(0.5 + 0.5 sin(2π f t))``, ``Z = R + jωL - j/(ωC)``,
    ``I = V/Z``. The reactance X is monotone in ω, L and C, so its bounds are exact but for
    rounding; the impedance takes the smallest size of X, which is 0 where X changes sign inside.

    Args:
        time: t in s.
        voltage: V in V, amplitude, >= 0.
        resistance: R_s in Ω, > 0.
        capacitance: C in F, > 0.
        source_frequency: ω/2π in Hz, > 0.
        minimum_inductance: Lmin in H, > 0.
        maximum_inductance: Lmax in H, > 0.
        frequency: f in Hz with which L swings, >= 0; the paper does not give it.

    Returns:
        Inductance, oscillation, reactance, impedance, current and phase, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [
        not_negative("voltage", voltage),
        positive("resistance", resistance),
        positive("capacitance", capacitance),
        positive("source_frequency", source_frequency),
        positive("minimum_inductance", minimum_inductance),
        positive("maximum_inductance", maximum_inductance),
        not_negative("frequency", frequency),
        parameter("time", time, FINITE),
    ]
    return Resonance(*evaluate(_resonance, parameters, 6))
