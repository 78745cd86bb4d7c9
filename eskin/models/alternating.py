"""A swinging capacitance at an alternating voltage: its current (eq. 7 and 8, Fig. 6)."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.jit import inlined, kernel
from eskin.kernels.outward_rounding import add_down, add_up, mul_down, mul_up, sub_down, sub_up
from eskin.kernels.sine import sincospi_of_product
from eskin.models.bounds import TWO_PI, U
from eskin.models.broadcasting import BLOCK, block_count, evaluate, load
from eskin.models.capacitive_chain import harmonic_capacitance
from eskin.models.parameters import FINITE, NOT_NEGATIVE, not_negative, parameter, positive, thin
from eskin.models.sinusoid import sine_of_time, weights_at

if TYPE_CHECKING:
    from eskin.interval import Interval
    from eskin.models.broadcasting import Operands, Results
    from eskin.models.parameters import Bounds, Floats, Parameter

SWING_FREQUENCY: Final = 2.0
"""Frequency f_c in Hz with which the capacitance of eq. 7 swings."""


class Swing(enum.Enum):
    """How the capacitance goes between its minimum and its maximum."""

    RAISED = 1.0
    """``Cmin + (Cmax - Cmin)·(0.5 + 0.5 sin)`` as in eq. 5: always between the two."""
    PAPER = 0.0
    """``Cmin + (Cmax - Cmin)·sin`` as eq. 7 is printed: half of the time below Cmin, and negative
    where ``sin < -Cmin/(Cmax - Cmin)``."""


@inlined
def _weighed_down(s: float, a: float, b_inf: float, b_sup: float) -> float:
    """Lower bound of ``(1 - s)·a + s·b`` for one ``-1 <= s <= 1``, ``a`` and ``b`` > 0."""
    return add_down(mul_down(sub_down(1.0, s), a), mul_down(s, b_inf if s >= 0.0 else b_sup))


@inlined
def _weighed_up(s: float, a: float, b_inf: float, b_sup: float) -> float:
    return add_up(mul_up(sub_up(1.0, s), a), mul_up(s, b_sup if s >= 0.0 else b_inf))


@kernel
def _capacitance_paper(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((10, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        sine_of_time(work, 4, 6, 8, n)
        lower, upper = out[0][start : start + n], out[1][start : start + n]
        for i in range(n):
            s_inf, s_sup = work[8, i], work[9, i]
            # The lower bound is concave in s, the upper one convex: an end of s gives it.
            lower[i] = min(
                _weighed_down(s_inf, work[0, i], work[2, i], work[3, i]),
                _weighed_down(s_sup, work[0, i], work[2, i], work[3, i]),
            )
            upper[i] = max(
                _weighed_up(s_inf, work[1, i], work[2, i], work[3, i]),
                _weighed_up(s_sup, work[1, i], work[2, i], work[3, i]),
            )
    return allowed


@inlined
def _weights(work: Floats, i: int, raised: float, moving: float) -> tuple[float, float, float]:
    """What Cmin and Cmax count in I/V0, and the greatest that either could count.

    ``I/V0 = Cmin·((1 - s)·c - s'·v) + Cmax·(s·c + s'·v)``: ``v`` is the sine of the voltage,
    ``c`` its derivative, and ``s'`` that of the swing. Without ``s'`` it is eq. 8.
    """
    v, c = sincospi_of_product(2.0 * work[6, i], work[10, i])
    sine, turn = sincospi_of_product(2.0 * work[8, i], work[10, i])
    s, rest = weights_at(work[8, i], work[10, i])
    s, rest = (s, rest) if raised > 0.0 else (sine, 1.0 - sine)
    w, w_swing = TWO_PI * work[6, i], moving * TWO_PI * work[8, i]
    c, m = w * c, (0.5 if raised > 0.0 else 1.0) * w_swing * turn * v
    return rest * c - m, s * c + m, 2.0 * (w + w_swing)


@kernel
def _current(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    """Bounds from the weights as they come out, set apart by what they may be wrong.

    In terms of ``most·(Cmin + Cmax)·V0``, a weight is within 8.5 U (a product of four factors that
    are within 6, 2, 2 and 1 U, where the factors of ``most`` are twice too great), what is done
    with it rounds by 3 U, and a weight of the wrong sign takes the wrong end for 8.5 U.
    """
    work = np.empty((16, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        lower, upper = out[0][start : start + n], out[1][start : start + n]
        for i in range(n):
            a, b, most = _weights(work, i, work[12, i], work[14, i])
            slack = 24.0 * U * most * (work[1, i] + work[3, i]) * work[5, i]
            low = a * (work[0, i] if a >= 0.0 else work[1, i])
            low += b * (work[2, i] if b >= 0.0 else work[3, i])
            lower[i] = low * (work[4, i] if low >= 0.0 else work[5, i]) - slack
            high = a * (work[1, i] if a >= 0.0 else work[0, i])
            high += b * (work[3, i] if b >= 0.0 else work[2, i])
            upper[i] = high * (work[5, i] if high >= 0.0 else work[4, i]) + slack
    return allowed


def alternating_capacitance_paper(
    time: Bounds,
    *,
    minimum_capacitance: Bounds,
    maximum_capacitance: Bounds,
    frequency: Bounds = SWING_FREQUENCY,
) -> Interval:
    """``C_t = Cmin + (Cmax - Cmin)·sin(2π f t)`` as eq. 7 is printed.

    With the paper's values it falls to -80 pF, which no capacitor has; it is negative from 0.259 s
    to 0.491 s in each period. `alternating_capacitance` is a form that a capacitor can have.

    Args:
        time: t in s.
        minimum_capacitance: Cmin in F, > 0; 10 pF in the paper.
        maximum_capacitance: Cmax in F, > 0; 100 pF in the paper.
        frequency: f_c in Hz, >= 0; 2 Hz in the paper.

    Returns:
        C_t in F, of the broadcast shape; exact but for rounding.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [
        positive("minimum_capacitance", minimum_capacitance),
        positive("maximum_capacitance", maximum_capacitance),
        not_negative("frequency", frequency),
        parameter("time", time, FINITE),
    ]
    return evaluate(_capacitance_paper, parameters, 1)[0]


def alternating_capacitance(
    time: Bounds,
    *,
    minimum_capacitance: Bounds,
    maximum_capacitance: Bounds,
    frequency: Bounds = SWING_FREQUENCY,
) -> Interval:
    """The capacitance of eq. 7, corrected: it swings between Cmin and Cmax, as in eq. 5.

    Args:
        time: t in s.
        minimum_capacitance: Cmin in F, > 0.
        maximum_capacitance: Cmax in F, > 0.
        frequency: f_c in Hz, >= 0.

    Returns:
        C_t in F, of the broadcast shape; exact but for rounding.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    return harmonic_capacitance(
        time,
        minimum_capacitance=minimum_capacitance,
        maximum_capacitance=maximum_capacitance,
        frequency=frequency,
    )


def _parameters(
    time: Bounds,
    minimum_capacitance: Bounds,
    maximum_capacitance: Bounds,
    voltage: Bounds,
    voltage_frequency: Bounds,
    frequency: Bounds,
    swing: Swing,
    *,
    moving: bool,
) -> list[Parameter]:
    return [
        positive("minimum_capacitance", minimum_capacitance),
        positive("maximum_capacitance", maximum_capacitance),
        not_negative("voltage", voltage),
        thin("voltage_frequency", voltage_frequency, NOT_NEGATIVE),
        thin("frequency", frequency, NOT_NEGATIVE),
        thin("time", time, FINITE),
        not_negative("swing", Swing(swing).value),
        not_negative("moving", float(moving)),
    ]


def alternating_current(
    time: Bounds,
    *,
    minimum_capacitance: Bounds,
    maximum_capacitance: Bounds,
    voltage: Bounds,
    voltage_frequency: Bounds,
    frequency: Bounds = SWING_FREQUENCY,
    swing: Swing = Swing.RAISED,
) -> Interval:
    """Current ``I = d(C V)/dt = C dV/dt + V dC/dt`` of a changing capacitor: eq. 8, corrected.

    ``V(t) = V₀ sin(2π f t)``. Written as ``V₀·(Cmin·a(t) + Cmax·b(t))``, in which each parameter
    counts once: the bounds are exact but for roundings of the terms.

    Args:
        time: t in s, one number each.
        minimum_capacitance: Cmin in F, > 0; 10 pF in the paper.
        maximum_capacitance: Cmax in F, > 0; 100 pF in the paper.
        voltage: V₀ in V, amplitude, >= 0; 5 V in the paper.
        voltage_frequency: f in Hz, >= 0, one number each; 50 Hz in the paper.
        frequency: f_c of the capacitance in Hz, >= 0, one number each; 2 Hz in the paper.
        swing: How the capacitance swings; `Swing.PAPER` for eq. 7 as printed.

    Returns:
        I in A, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = _parameters(
        time,
        minimum_capacitance,
        maximum_capacitance,
        voltage,
        voltage_frequency,
        frequency,
        swing,
        moving=True,
    )
    return evaluate(_current, parameters, 1)[0]


def alternating_current_paper(
    time: Bounds,
    *,
    minimum_capacitance: Bounds,
    maximum_capacitance: Bounds,
    voltage: Bounds,
    voltage_frequency: Bounds,
    frequency: Bounds = SWING_FREQUENCY,
    swing: Swing = Swing.PAPER,
) -> Interval:
    """Current ``I = C dV/dt``: eq. 8 as printed, with the capacitance of eq. 7.

    It leaves out ``V dC/dt``, up to 5.6 nA with the paper's values; `alternating_current` has it.

    Args:
        time: t in s, one number each.
        minimum_capacitance: Cmin in F, > 0; 10 pF in the paper.
        maximum_capacitance: Cmax in F, > 0; 100 pF in the paper.
        voltage: V₀ in V, amplitude, >= 0; 5 V in the paper.
        voltage_frequency: f in Hz, >= 0, one number each; 50 Hz in the paper.
        frequency: f_c of the capacitance in Hz, >= 0, one number each; 2 Hz in the paper.
        swing: How the capacitance swings.

    Returns:
        I in A, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = _parameters(
        time,
        minimum_capacitance,
        maximum_capacitance,
        voltage,
        voltage_frequency,
        frequency,
        swing,
        moving=False,
    )
    return evaluate(_current, parameters, 1)[0]
