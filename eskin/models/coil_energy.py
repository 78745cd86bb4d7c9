"""The energy that a coil loses (eq. 30): the solution, enclosed. Its Euler form is elsewhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.kernels.exponential import exp_down, exp_up
from eskin.kernels.intrinsics import fma
from eskin.kernels.jit import kernel, part
from eskin.models.bounds import TINY, above, below
from eskin.models.broadcasting import BLOCK, block_count, evaluate, load
from eskin.models.parameters import not_negative, positive

if TYPE_CHECKING:
    from eskin.interval import Interval
    from eskin.models.broadcasting import Operands, Results
    from eskin.models.parameters import Bounds, Floats


@part
def _exponent(z: float, t: float, inductance: float) -> tuple[float, float]:
    """``2 z t / L`` as a float and what its rounding left.

    An error of one rounding in an exponent of 700 would be 700 in the exponential. Beyond, the
    exponential is nothing.
    """
    product = 2.0 * z * t
    x = product / inductance
    rest = (fma(-x, inductance, product) + fma(2.0 * z, t, -product)) / inductance
    return x, rest if x < 1000.0 else 0.0


@kernel
def _coil_energy(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((8, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        lower, upper = out[0][start : start + n], out[1][start : start + n]
        for i in range(n):
            current = work[0, i] / work[5, i]
            x, rest = _exponent(work[5, i], work[7, i], work[2, i])
            energy = 0.5 * work[2, i] * current * current * (exp_down(-x) * (1.0 - rest))
            lower[i] = max(below(energy, 9) - TINY, 0.0)
            current = work[1, i] / work[4, i]
            x, rest = _exponent(work[4, i], work[6, i], work[3, i])
            energy = 0.5 * work[3, i] * current * current * (exp_up(-x) * (1.0 - rest))
            upper[i] = above(energy, 9) + TINY
    return allowed


def coil_energy(
    time: Bounds, *, voltage: Bounds, loss_resistance: Bounds, inductance: Bounds
) -> Interval:
    """Energy ``E(t) = ½ L (V/Z)²·e^(-2 Z t/L)`` of a coil that its losses drain (eq. 30).

    The paper's ``dE/dt = -I² Z`` with ``E = ½ L I²`` has this solution, with E₀ of the current
    ``I₀ = V/Z``. It grows with L and V and falls with Z, so the bounds are exact but for rounding.
    `eskin.models.euler.coil_energy_euler_paper` is the stepwise form that the paper evaluates.

    Args:
        time: t in s, >= 0.
        voltage: V in V, >= 0; 0.9 to 1.1 V in the paper.
        loss_resistance: The paper's Z_L in Ω, > 0; 4 to 6 Ω in the paper.
        inductance: L in H, > 0; 9 to 11 mH in the paper.

    Returns:
        E in J, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [
        not_negative("voltage", voltage),
        positive("inductance", inductance),
        positive("loss_resistance", loss_resistance),
        not_negative("time", time),
    ]
    return evaluate(_coil_energy, parameters, 1)[0]
