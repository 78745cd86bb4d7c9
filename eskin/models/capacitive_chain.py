"""From a capacitance to a current: the measuring chain of Fig. 3 and Fig. 5 (eq. 5, 6, V, I)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.models.bounds import TWO_PI, above, below
from eskin.models.broadcasting import BLOCK, block_count, evaluate, load
from eskin.models.parameters import FINITE, not_negative, parameter, positive
from eskin.models.sinusoid import mixed_down, mixed_up, raise_sine

if TYPE_CHECKING:
    from eskin.interval import Interval
    from eskin.models.broadcasting import Operands, Results
    from eskin.models.parameters import Bounds, Floats, Parameter

HARMONIC_FREQUENCY: Final = 2.0
"""Frequency in Hz with which the capacitance of eq. 5 swings."""


@dataclass(frozen=True, slots=True)
class CapacitiveChain:
    """What the chain gives.

    Attributes:
        capacitance: C_t in F (eq. 5).
        frequency: f_t in Hz (eq. 6).
        voltage: V_t = f_t / max f_t, between 0 and 1.
        current: I_t = G_m·V_t in A.
    """

    capacitance: Interval
    frequency: Interval
    voltage: Interval
    current: Interval


@kernel
def _harmonic(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((12, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        raise_sine(work, 4, 6, 8, n)
        lower, upper = out[0][start : start + n], out[1][start : start + n]
        for i in range(n):
            lower[i] = mixed_down(work, 8, i, work[0, i], work[2, i])
            upper[i] = mixed_up(work, 8, i, work[1, i], work[3, i])
    return allowed


@part
def _voltage(work: Floats, at: int, i: int) -> tuple[float, float]:
    """Bounds of V = min(Cmin, Cmax) / C = 1 / ((1 - s) + s·ρ), ρ = Cmax/Cmin.

    It falls with ρ where ρ > 1. Where Cmin and Cmax overlap, members may stand the other way
    round, and then it grows; a quotient above 1 belongs to no member.
    """
    min_inf, min_sup, max_inf, max_sup = work[0, i], work[1, i], work[2, i], work[3, i]
    wide, narrow = (
        mixed_up(work, at, i, min_inf, max_sup),
        mixed_down(work, at, i, min_sup, max_inf),
    )
    steep = min(min_inf / wide, max_inf / mixed_up(work, at, i, min_sup, max_inf))
    flat = min(min_sup / narrow, max_sup / mixed_down(work, at, i, min_inf, max_sup))
    return below(steep, 1), min(above(flat, 1), 1.0)


@kernel
def _chain(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((16, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        raise_sine(work, 4, 10, 12, n)
        _capacitance_and_frequency(work, out, start, n)
        _voltage_and_current(work, out, start, n)
    return allowed


@part
def _capacitance_and_frequency(work: Floats, out: Results, start: int, n: int) -> None:
    c_lower, c_upper = out[0][start : start + n], out[1][start : start + n]
    f_lower, f_upper = out[2][start : start + n], out[3][start : start + n]
    for i in range(n):
        c_inf = mixed_down(work, 12, i, work[0, i], work[2, i])
        c_sup = mixed_up(work, 12, i, work[1, i], work[3, i])
        c_lower[i], c_upper[i] = c_inf, c_sup
        f_lower[i] = below(1.0 / (TWO_PI * work[7, i] * c_sup), 4)
        f_upper[i] = above(1.0 / (TWO_PI * work[6, i] * c_inf), 4)


@part
def _voltage_and_current(work: Floats, out: Results, start: int, n: int) -> None:
    v_lower, v_upper = out[4][start : start + n], out[5][start : start + n]
    i_lower, i_upper = out[6][start : start + n], out[7][start : start + n]
    for i in range(n):
        v_inf, v_sup = _voltage(work, 12, i)
        v_lower[i], v_upper[i] = v_inf, v_sup
        i_lower[i] = below(work[8, i] * v_inf, 1)
        i_upper[i] = above(work[9, i] * v_sup, 1)


@kernel
def _current(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((14, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        raise_sine(work, 4, 8, 10, n)
        lower, upper = out[0][start : start + n], out[1][start : start + n]
        for i in range(n):
            v_inf, v_sup = _voltage(work, 10, i)
            lower[i] = below(work[6, i] * v_inf, 1)
            upper[i] = above(work[7, i] * v_sup, 1)
    return allowed


def _swing(minimum: Bounds, maximum: Bounds, frequency: Bounds) -> list[Parameter]:
    return [
        positive("minimum_capacitance", minimum),
        positive("maximum_capacitance", maximum),
        not_negative("frequency", frequency),
    ]


def harmonic_capacitance(
    time: Bounds,
    *,
    minimum_capacitance: Bounds,
    maximum_capacitance: Bounds,
    frequency: Bounds = HARMONIC_FREQUENCY,
) -> Interval:
    """Capacitance that swings, ``C_t = Cmin + (Cmax - Cmin)·(0.5 + 0.5 sin(2π f t))`` (eq. 5).

    As the paper has it; written as a swing, so that the bounds are exact but for rounding.

    Args:
        time: t in s, from -1e40 to 1e40.
        minimum_capacitance: Cmin in F, > 0.
        maximum_capacitance: Cmax in F, > 0.
        frequency: f in Hz, >= 0; 2 Hz in the paper.

    Returns:
        C_t in F, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = _swing(minimum_capacitance, maximum_capacitance, frequency)
    return evaluate(_harmonic, [*parameters, parameter("time", time, FINITE)], 1)[0]


def capacitive_chain(
    time: Bounds,
    *,
    minimum_capacitance: Bounds,
    maximum_capacitance: Bounds,
    resistance: Bounds,
    transconductance: Bounds,
    frequency: Bounds = HARMONIC_FREQUENCY,
) -> CapacitiveChain:
    """The chain of Fig. 3: capacitance, oscillator, voltage, current (eq. 5 and 6, V_t, I_t).

    ``f_t = 1/(2π R C_t)``, ``V_t = f_t / max f_t``, ``I_t = G_m V_t``. R and one of the C cancel in
    V_t, which is evaluated as ``1/((1 - s) + s·Cmax/Cmin)``: it never exceeds 1, and all bounds
    are exact but for rounding. ``max f_t`` is that of a whole period, with the same parameters.

    Args:
        time: t in s, from -1e40 to 1e40.
        minimum_capacitance: Cmin in F, > 0.
        maximum_capacitance: Cmax in F, > 0.
        resistance: R of the oscillator in Ω, > 0; 1 kΩ in the paper.
        transconductance: G_m in A/V, > 0. The paper's 1 mA/V gives 100 µA to 1 mA; its text and
            figures (100 nA to 1 µA) belong to 1 µA/V.
        frequency: f of the swing in Hz, >= 0; 2 Hz in the paper.

    Returns:
        The four quantities, each of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [
        *_swing(minimum_capacitance, maximum_capacitance, frequency),
        positive("resistance", resistance),
        positive("transconductance", transconductance),
        parameter("time", time, FINITE),
    ]
    return CapacitiveChain(*evaluate(_chain, parameters, 4))


def chain_current(
    time: Bounds,
    *,
    minimum_capacitance: Bounds,
    maximum_capacitance: Bounds,
    transconductance: Bounds,
    frequency: Bounds = HARMONIC_FREQUENCY,
) -> Interval:
    """The current of `capacitive_chain` alone, in A: R cancels in it.

    Args:
        time: t in s, from -1e40 to 1e40.
        minimum_capacitance: Cmin in F, > 0.
        maximum_capacitance: Cmax in F, > 0.
        transconductance: G_m in A/V, > 0.
        frequency: f of the swing in Hz, >= 0; 2 Hz in the paper.

    Returns:
        I_t in A, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [
        *_swing(minimum_capacitance, maximum_capacitance, frequency),
        positive("transconductance", transconductance),
        parameter("time", time, FINITE),
    ]
    return evaluate(_current, parameters, 1)[0]
