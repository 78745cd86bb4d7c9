"""Oscillators that turn a capacitance or an inductance into a frequency (eq. 3, 4 and 6)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from eskin.kernels.jit import kernel
from eskin.models.bounds import TWO_PI, above, below
from eskin.models.broadcasting import BLOCK, block_count, evaluate, load
from eskin.models.parameters import positive

if TYPE_CHECKING:
    from eskin.interval import Interval
    from eskin.models.broadcasting import Operands, Results
    from eskin.models.parameters import Bounds, Floats


@kernel
def _lc_frequency(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((4, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        lower, upper = out[0][start : start + n], out[1][start : start + n]
        for i in range(n):
            lower[i] = below(1.0 / (TWO_PI * math.sqrt(work[1, i] * work[3, i])), 5)
            upper[i] = above(1.0 / (TWO_PI * math.sqrt(work[0, i] * work[2, i])), 5)
    return allowed


@kernel
def _rc_frequency(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((4, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        lower, upper = out[0][start : start + n], out[1][start : start + n]
        for i in range(n):
            lower[i] = below(1.0 / (TWO_PI * work[1, i] * work[3, i]), 4)
            upper[i] = above(1.0 / (TWO_PI * work[0, i] * work[2, i]), 4)
    return allowed


@kernel
def _rc_frequency_paper(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((4, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        lower, upper = out[0][start : start + n], out[1][start : start + n]
        for i in range(n):
            lower[i] = below(1.0 / (work[1, i] * work[3, i]), 2)
            upper[i] = above(1.0 / (work[0, i] * work[2, i]), 2)
    return allowed


def lc_frequency(*, inductance: Bounds, capacitance: Bounds) -> Interval:
    """Frequency ``f = 1 / (2π √(L C))`` of an LC oscillator (eq. 3 and 12), as the paper has it.

    Monotone: the bounds are exact but for rounding.

    Args:
        inductance: L in H, > 0.
        capacitance: C in F, > 0.

    Returns:
        f in Hz, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [positive("inductance", inductance), positive("capacitance", capacitance)]
    return evaluate(_lc_frequency, parameters, 1)[0]


def rc_frequency(*, resistance: Bounds, capacitance: Bounds) -> Interval:
    """Frequency ``f = 1 / (2π R C)`` of an RC oscillator (eq. 6), as the paper has it.

    Monotone: the bounds are exact but for rounding.

    Args:
        resistance: R in Ω, > 0; 1 kΩ in the paper.
        capacitance: C in F, > 0.

    Returns:
        f in Hz, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [positive("resistance", resistance), positive("capacitance", capacitance)]
    return evaluate(_rc_frequency, parameters, 1)[0]


def rc_frequency_paper(*, resistance: Bounds, capacitance: Bounds) -> Interval:
    """``f = 1 / (R C)``: eq. 4 as printed, without the 2π; `rc_frequency` has it.

    Args:
        resistance: R in Ω, > 0.
        capacitance: C in F, > 0.

    Returns:
        An angular frequency in rad/s, which the paper calls f in Hz; of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [positive("resistance", resistance), positive("capacitance", capacitance)]
    return evaluate(_rc_frequency_paper, parameters, 1)[0]
