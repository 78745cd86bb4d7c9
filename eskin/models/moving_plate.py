"""A capacitor whose plates come nearer and go (eq. 9, Fig. 7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.constants import VACUUM_PERMITTIVITY
from eskin.kernels.jit import kernel
from eskin.models.bounds import above, below
from eskin.models.broadcasting import BLOCK, block_count, evaluate, load
from eskin.models.parameters import (
    FINITE,
    not_negative,
    parameter,
    positive,
)
from eskin.models.sinusoid import mixed_down, mixed_up, raise_sine

if TYPE_CHECKING:
    from eskin.interval import Interval
    from eskin.models.broadcasting import Operands, Results
    from eskin.models.parameters import Bounds, Floats

PLATE_FREQUENCY: Final = 0.5
"""Frequency in Hz with which the distance of eq. 9 swings."""


@dataclass(frozen=True, slots=True)
class MovingPlate:
    """A plate on its way.

    Attributes:
        distance: d_t in m (eq. 9).
        capacitance: C_t = ε₀ εᵣ A / d_t in F.
    """

    distance: Interval
    capacitance: Interval


@kernel
def _moving_plate(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((18, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        raise_sine(work, 10, 12, 14, n)
        d_lower, d_upper = out[0][start : start + n], out[1][start : start + n]
        c_lower, c_upper = out[2][start : start + n], out[3][start : start + n]
        for i in range(n):
            d_inf = mixed_down(work, 14, i, work[6, i], work[8, i])
            d_sup = mixed_up(work, 14, i, work[7, i], work[9, i])
            d_lower[i], d_upper[i] = d_inf, d_sup
            c_lower[i] = below(work[0, i] * work[2, i] * work[4, i] / d_sup, 3)
            c_upper[i] = above(work[1, i] * work[3, i] * work[5, i] / d_inf, 3)
    return allowed


def moving_plate(
    time: Bounds,
    *,
    area: Bounds,
    minimum_distance: Bounds,
    maximum_distance: Bounds,
    frequency: Bounds = PLATE_FREQUENCY,
    relative_permittivity: Bounds = 1.0,
    vacuum_permittivity: Bounds = VACUUM_PERMITTIVITY,
) -> MovingPlate:
    """Distance ``d_t = dmin + (dmax - dmin)·(0.5 + 0.5 sin(2π f t))`` (eq. 9) and capacitance.

    As the paper has it, but for nature's ε₀. The bounds are exact but for rounding.

    Args:
        time: t in s.
        area: A in m², > 0; 1 cm² in the paper.
        minimum_distance: dmin in m, > 0; 1 mm in the paper.
        maximum_distance: dmax in m, > 0; 5 mm in the paper.
        frequency: f in Hz, >= 0; 0.5 Hz in the paper.
        relative_permittivity: εᵣ, > 0; the paper leaves it out.
        vacuum_permittivity: ε₀ in F/m, > 0; the paper rounds it to 8.854e-12.

    Returns:
        d_t and C_t, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [
        positive("vacuum_permittivity", vacuum_permittivity),
        positive("relative_permittivity", relative_permittivity),
        positive("area", area),
        positive("minimum_distance", minimum_distance),
        positive("maximum_distance", maximum_distance),
        not_negative("frequency", frequency),
        parameter("time", time, FINITE),
    ]
    return MovingPlate(*evaluate(_moving_plate, parameters, 2))
