"""The voltage of an oscillator whose frequency changes (eq. 12, Fig. 9)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import Interval
from eskin.interval.conversion import as_compiled
from eskin.kernels.jit import kernel
from eskin.kernels.outward_rounding import add_down, add_up, mul_down, mul_up, sub_down, sub_up
from eskin.kernels.rounding_mode import rounding_to_nearest
from eskin.models.bounds import product_down, product_up
from eskin.models.broadcasting import BLOCK, block_count, evaluate, load
from eskin.models.parameters import FINITE, not_negative, parameter, thin
from eskin.models.sinusoid import sine_of_time

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eskin.models.broadcasting import Operands, Results
    from eskin.models.parameters import Bounds, Floats


@kernel
def _oscillation(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((8, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        sine_of_time(work, 2, 4, 6, n)
        lower, upper = out[0][start : start + n], out[1][start : start + n]
        for i in range(n):
            lower[i] = product_down(work[0, i], work[1, i], work[6, i], work[7, i])
            upper[i] = product_up(work[0, i], work[1, i], work[6, i], work[7, i])
    return allowed


@kernel
def _accumulate(inf: Floats, sup: Floats, times: Floats, lower: Floats, upper: Floats) -> None:
    """Bounds of ``∫ f dt`` up to each time, rounded outward; ``f >= 0``, times rise."""
    for row in range(inf.shape[0]):
        least, most = 0.0, 0.0
        lower[row, 0], upper[row, 0] = least, most
        for k in range(inf.shape[1]):
            least = add_down(least, mul_down(inf[row, k], sub_down(times[k + 1], times[k])))
            most = add_up(most, mul_up(sup[row, k], sub_up(times[k + 1], times[k])))
            lower[row, k + 1], upper[row, k + 1] = least, most


def oscillation_paper(time: Bounds, *, voltage: Bounds, frequency: Bounds) -> Interval:
    """``V(t) = V₀ sin(2π f t)`` with the frequency of the instant, as Fig. 9 has it.

    Where f changes, this is not how an oscillator swings: its phase is the integral of f, and
    `oscillation` has it.

    Args:
        time: t in s.
        voltage: V₀ in V, >= 0; 5 V in the paper.
        frequency: f in Hz at each time, >= 0.

    Returns:
        V in V, of the broadcast shape; exact but for rounding.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [
        not_negative("voltage", voltage),
        not_negative("frequency", frequency),
        parameter("time", time, FINITE),
    ]
    return evaluate(_oscillation, parameters, 1)[0]


def oscillation(time: ArrayLike, *, voltage: Bounds, frequency: Interval) -> Interval:
    """``V(t) = V₀ sin(2π ∫ f dt)``: Fig. 9, corrected.

    Args:
        time: Instants in s that rise, n + 1 on one axis; the phase is 0 at the first.
        voltage: V₀ in V, >= 0; one for each row of the frequency.
        frequency: f in Hz over each of the n steps between them, time on the last axis:
            `eskin.models.proximity` gives it for ``Interval(time[:-1], time[1:])``.

    Returns:
        V in V at each instant, time on the last axis. The width grows with what f may change
        within a step, times the steps: finer steps make it tighter.

    Raises:
        IntervalError: A parameter is not allowed, times do not rise, or shapes do not fit.
    """
    instants = np.asarray(thin("time", time, FINITE).inf)
    if instants.ndim != 1 or instants.size < 2 or not np.all(np.diff(instants) > 0.0):
        raise IntervalError("time must be two or more instants that rise on one axis")
    steps = not_negative("frequency", frequency)
    steps.require_allowed()
    if steps.inf.ndim == 0 or steps.inf.shape[-1] != instants.size - 1:
        raise IntervalError(
            f"frequency must have one value for each of the {instants.size - 1} steps on its "
            f"last axis, is of shape {steps.inf.shape}"
        )
    return oscillation_paper(_phase(steps.interval, instants), voltage=voltage, frequency=1.0)


@rounding_to_nearest
def _phase(frequency: Interval, instants: Floats) -> Interval:
    """Periods since the first instant."""
    shape = (*frequency.inf.shape[:-1], instants.size)
    inf = as_compiled(frequency.inf).reshape(-1, instants.size - 1)
    sup = as_compiled(frequency.sup).reshape(-1, instants.size - 1)
    lower, upper = (np.empty((inf.shape[0], instants.size)) for _ in "lu")
    _accumulate(inf, sup, as_compiled(instants), lower, upper)
    return Interval(lower.reshape(shape), upper.reshape(shape))
