"""The coil at a source: its current by size and phase (eq. 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.models.bounds import TWO_PI, above, below
from eskin.models.broadcasting import BLOCK, block_count, evaluate, load
from eskin.models.parameters import not_negative, positive

if TYPE_CHECKING:
    from eskin.interval import Interval
    from eskin.models.broadcasting import Operands, Results
    from eskin.models.parameters import Bounds, Floats


@dataclass(frozen=True, slots=True)
class CoilCurrent:
    """A current as a phasor.

    Attributes:
        magnitude: Its amplitude in A.
        phase: Its lead over the voltage in rad; negative, as a coil's current lags.
    """

    magnitude: Interval
    phase: Interval


@part
def angle_down(slope: float) -> float:
    """Lower bound of the arctangent; the library's error is allowed 2 ulp."""
    angle = math.atan(slope)
    return below(angle, 4) if angle >= 0.0 else -above(-angle, 4)


@part
def angle_up(slope: float) -> float:
    """Upper bound of the arctangent."""
    return -angle_down(-slope)


@kernel
def _coil_current(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((8, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        m_lower, m_upper = out[0][start : start + n], out[1][start : start + n]
        p_lower, p_upper = out[2][start : start + n], out[3][start : start + n]
        for i in range(n):
            x_inf, x_sup = TWO_PI * work[6, i] * work[4, i], TWO_PI * work[7, i] * work[5, i]
            r_inf, r_sup = work[2, i], work[3, i]
            m_lower[i] = below(work[0, i] / math.sqrt(r_sup * r_sup + x_sup * x_sup), 7)
            m_upper[i] = above(work[1, i] / math.sqrt(r_inf * r_inf + x_inf * x_inf), 7)
            p_lower[i] = -angle_up(above(x_sup / r_inf, 4))
            p_upper[i] = -angle_down(below(x_inf / r_sup, 4))
    return allowed


def coil_current(
    *, voltage: Bounds, resistance: Bounds, inductance: Bounds, frequency: Bounds
) -> CoilCurrent:
    """Current ``I = V / (R + jωL)`` of a coil at a harmonic source (eq. 1), as the paper has it.

    Monotone in every parameter: the bounds are exact but for rounding. The paper's Z_L of 4 to
    6 Ω is the resistance R: ωL alone is 57 to 69 Ω there.

    Args:
        voltage: V in V, amplitude, >= 0; 0.9 to 1.1 V in the paper.
        resistance: R in Ω, > 0; 4 to 6 Ω in the paper.
        inductance: L in H, > 0; 9 to 11 mH in the paper.
        frequency: f in Hz, >= 0; 1 kHz in the paper.

    Returns:
        Amplitude and phase, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [
        not_negative("voltage", voltage),
        positive("resistance", resistance),
        positive("inductance", inductance),
        not_negative("frequency", frequency),
    ]
    return CoilCurrent(*evaluate(_coil_current, parameters, 2))
