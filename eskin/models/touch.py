"""A touch that changes the area of a capacitor, and with it the stored energy (eq. 10, Fig. 8)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.constants import VACUUM_PERMITTIVITY
from eskin.kernels.jit import kernel, part
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
    from eskin.models.parameters import Bounds, Floats, Parameter

TOUCH_FREQUENCY: Final = 0.8
"""Frequency in Hz with which the area of eq. 10 swings."""


@dataclass(frozen=True, slots=True)
class Touch:
    """What a touch does to a taxel.

    Attributes:
        area: A_t in m² (eq. 10).
        capacitance: C_t = ε₀ εᵣ A_t / d in F.
        energy: ½ C_t V² in J.
    """

    area: Interval
    capacitance: Interval
    energy: Interval


@kernel
def _touch(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((20, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        raise_sine(work, 12, 14, 16, n)
        lower, upper = out[0][start : start + n], out[1][start : start + n]
        for i in range(n):
            lower[i] = mixed_down(work, 16, i, work[8, i], work[10, i])
            upper[i] = mixed_up(work, 16, i, work[9, i], work[11, i])
        _store(work, out, start, n)
    return allowed


@kernel
def _touch_of_area(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((10, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        out[0][start : start + n] = work[8, :n]
        out[1][start : start + n] = work[9, :n]
        _store(work, out, start, n)
    return allowed


@part
def _store(work: Floats, out: Results, start: int, n: int) -> None:
    """Capacitance and energy out of the area, which stands in ``out`` already."""
    a_lower, a_upper = out[0][start : start + n], out[1][start : start + n]
    c_lower, c_upper = out[2][start : start + n], out[3][start : start + n]
    e_lower, e_upper = out[4][start : start + n], out[5][start : start + n]
    for i in range(n):
        c_inf = below(work[0, i] * work[2, i] * a_lower[i] / work[5, i], 3)
        c_sup = above(work[1, i] * work[3, i] * a_upper[i] / work[4, i], 3)
        c_lower[i], c_upper[i] = c_inf, c_sup
        e_lower[i] = below(0.5 * c_inf * work[6, i] * work[6, i], 2)
        e_upper[i] = above(0.5 * c_sup * work[7, i] * work[7, i], 2)


def _plate(
    distance: Bounds,
    voltage: Bounds,
    relative_permittivity: Bounds,
    vacuum_permittivity: Bounds,
) -> list[Parameter]:
    return [
        positive("vacuum_permittivity", vacuum_permittivity),
        positive("relative_permittivity", relative_permittivity),
        positive("distance", distance),
        not_negative("voltage", voltage),
    ]


def touch(
    time: Bounds,
    *,
    minimum_area: Bounds,
    maximum_area: Bounds,
    distance: Bounds,
    voltage: Bounds,
    frequency: Bounds = TOUCH_FREQUENCY,
    relative_permittivity: Bounds = 1.0,
    vacuum_permittivity: Bounds = VACUUM_PERMITTIVITY,
) -> Touch:
    """Touched area ``A_t = Amin + (Amax - Amin)·(0.5 + 0.5 sin(2π f t))`` (eq. 10), C and ½CV².

    As the paper has it, but for nature's ε₀. The bounds are exact but for rounding.

    Args:
        time: t in s.
        minimum_area: Amin in m², > 0; 0.1 cm² in the paper.
        maximum_area: Amax in m², > 0; 1 cm² in the paper.
        distance: d in m, > 0; 1 mm in the paper.
        voltage: V in V, >= 0; the paper reckons with 0.5 V.
        frequency: f in Hz, >= 0; 0.8 Hz in the paper.
        relative_permittivity: εᵣ, > 0; the paper leaves it out.
        vacuum_permittivity: ε₀ in F/m, > 0; the paper rounds it to 8.854e-12.

    Returns:
        Area, capacitance and energy, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [
        *_plate(distance, voltage, relative_permittivity, vacuum_permittivity),
        positive("minimum_area", minimum_area),
        positive("maximum_area", maximum_area),
        not_negative("frequency", frequency),
        parameter("time", time, FINITE),
    ]
    return Touch(*evaluate(_touch, parameters, 3))


def touch_of_area(
    area: Bounds,
    *,
    distance: Bounds,
    voltage: Bounds,
    relative_permittivity: Bounds = 1.0,
    vacuum_permittivity: Bounds = VACUUM_PERMITTIVITY,
) -> Touch:
    """Capacitance and energy of a touched area that is known otherwise, a noisy one say.

    Args:
        area: A in m², >= 0.
        distance: d in m, > 0.
        voltage: V in V, >= 0.
        relative_permittivity: εᵣ, > 0.
        vacuum_permittivity: ε₀ in F/m, > 0; the paper rounds it to 8.854e-12.

    Returns:
        Area, capacitance and energy, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [
        *_plate(distance, voltage, relative_permittivity, vacuum_permittivity),
        not_negative("area", area),
    ]
    return Touch(*evaluate(_touch_of_area, parameters, 3))
