"""The q-relaxed intersection of intervals, compiled."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import IdentificationError
from eskin.interval import Interval
from eskin.kernels.jit import kernel, part
from eskin.kernels.outward_rounding import add_down, add_up, mul_down, next_down, next_up
from eskin.kernels.rounding_mode import rounding_to_nearest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats

    Integers = NDArray[np.int64]

_EXACT: Final = 2.0**53
"""Whole numbers up to it are floats."""


@part
def _leftmost(lows: Floats, highs: Floats, outliers: int) -> float:
    """The least point that lies in all but ``outliers`` intervals; ``inf`` where none does.

    Points to the left of an interval have its lower bound above them, and points to the right have
    its upper bound below. The leftmost point is the lower bound of an interval, and at most q lower
    bounds are above it: so it is one of the q + 1 greatest.

    Args:
        lows: The q + 1 greatest lower bounds, ascending.
        highs: The q + 1 least upper bounds, ascending.
        outliers: q.
    """
    below = 0
    for k in range(lows.size):
        # Of equal bounds the last one has the fewest above it.
        above = lows.size - 1 - k
        while below < highs.size and highs[below] < lows[k]:
            below += 1
        if above + below <= outliers:
            return float(lows[k])
    return inf


@part
def hull(lows: Floats, highs: Floats, outliers: int) -> tuple[float, float]:
    """Hull of the points that lie in all but ``outliers`` intervals, none of which is empty.

    Returns:
        Both ends; ``inf`` and ``-inf`` where there is no such point.
    """
    if outliers >= lows.size:
        return -inf, inf
    greatest = np.sort(np.partition(lows, lows.size - 1 - outliers)[lows.size - 1 - outliers :])
    least = np.sort(np.partition(highs, outliers)[: outliers + 1])
    left = _leftmost(greatest, least, outliers)
    if left == inf:
        return inf, -inf
    # The rightmost point is the leftmost one of the mirrored intervals.
    return left, -_leftmost(-least[::-1], -greatest[::-1], outliers)


@kernel
def find_hulls(lows: Floats, highs: Floats, outliers: int, out: Floats) -> None:
    """Hulls of rows of intervals; ``out`` has shape (2, rows)."""
    for row in range(lows.shape[0]):
        out[0, row], out[1, row] = hull(lows[row], highs[row], outliers)


@part
def _drift_down(rate: float, least: int, most: int) -> float:
    """At most ``rate·age`` for any age between two in ns, which are not negative."""
    age = float(most if rate < 0.0 else least)
    if age >= _EXACT:
        age = next_up(age) if rate < 0.0 else next_down(age)
    return mul_down(rate, age)


@kernel
def find_drifted_hulls(
    instants: Integers,
    bounds: Floats,
    counts: Integers,
    times: Integers,
    memory: int,
    outliers: int,
    rates: Floats,
    out: Floats,
) -> None:
    """Hulls of the latest constraints at some times, each widened by the drift since its instant.

    Args:
        instants: Earliest and latest instant of each constraint in ns, (2, n).
        bounds: Of the logarithm, (2, n).
        counts: How many constraints count at each time, the first ones.
        times: In ns, none before an instant of what counts.
        memory: How many of these are taken at most, the last ones.
        outliers: How many may be wrong.
        rates: Least and greatest rate of the logarithm, a ns.
        out: Bounds of the logarithm at the times, (2, times).
    """
    lows, highs = np.empty(memory), np.empty(memory)
    for k in range(times.size):
        first = max(counts[k] - memory, 0)
        size = counts[k] - first
        for j in range(size):
            younger = times[k] - instants[1, first + j]
            older = times[k] - instants[0, first + j]
            lows[j] = add_down(bounds[0, first + j], _drift_down(rates[0], younger, older))
            highs[j] = add_up(bounds[1, first + j], -_drift_down(-rates[1], younger, older))
        out[0, k], out[1, k] = hull(lows[:size], highs[:size], outliers)


@rounding_to_nearest
def relaxed_intersection(constraints: Interval, outliers: int) -> Interval:
    """Hull of all points that lie in all but some of many intervals (q-relaxed intersection).

    Args:
        constraints: N intervals along the last axis, none of which is empty.
        outliers: q: in so many of them a point need not lie. From N on, nothing is known.

    Returns:
        The shape without the last axis; empty where no point lies in N - q of them.

    Raises:
        IdentificationError: ``outliers`` is negative, a constraint is empty, or there is no axis.
    """
    if outliers < 0:
        raise IdentificationError(f"outliers must not be negative, not {outliers!r}")
    if constraints.ndim == 0 or np.any(constraints.is_empty):
        raise IdentificationError("constraints need an axis, and none may be empty")
    shape = constraints.shape[:-1]
    rows = int(np.prod(shape, dtype=np.int64))
    lows, highs = (
        np.ascontiguousarray(side, dtype=np.float64).reshape(rows, constraints.shape[-1])
        for side in (constraints.inf, constraints.sup)
    )
    out = np.empty((2, rows))
    find_hulls(lows, highs, outliers, out)
    return as_intervals(out, shape)


def as_intervals(hulls: Floats, shape: tuple[int, ...]) -> Interval:
    """Hulls as a kernel gives them, (2, n), as intervals."""
    lo, hi = hulls.reshape(2, *shape)
    empty = lo > hi
    found = Interval(np.where(empty, 0.0, lo), np.where(empty, 0.0, hi))
    return Interval.where(empty, Interval.empty(), found)
