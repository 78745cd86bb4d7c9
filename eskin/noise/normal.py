"""Tails of the normal distribution, enclosed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import Interval, as_interval, require_plain

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_ERFC_ERROR: Final = 1e-12
"""Relative error of the C library's ``erfc``, at most: known ones err by 1e-15 (glibc's manual)."""
_LEAST: Final = 1e-320
"""More than its error where the result is subnormal."""


def upper_tail(deviations: Interval | ArrayLike) -> Interval:
    """Enclose the probability that a normal variable is this much above its mean, or more.

    Args:
        deviations: In standard deviations, any shape; negative below the mean.

    Returns:
        ``erfc(x/√2)/2`` of each interval, within [0, 1]; the same shape.

    Raises:
        IntervalError: It is no array of real numbers, or carries a unit.
    """
    scaled = as_interval(deviations) / Interval(2.0).sqrt()
    least, most = (np.asarray(_erfc(side)) for side in (scaled.sup, scaled.inf))
    inf = least * (1.0 - _ERFC_ERROR) - _LEAST
    sup = most * (1.0 + _ERFC_ERROR) + _LEAST
    return Interval(np.clip(0.5 * inf, 0.0, 1.0), np.clip(0.5 * sup, 0.0, 1.0))


def coverage_within(deviations: float) -> float:
    """Share of a normal distribution within so many standard deviations of its mean, at least.

    ``1 - erfc(k/√2)``, rounded down. It is less than 1 for every number of deviations: only a hard
    bound gives certainty.

    Raises:
        IntervalError: The number is negative or NaN, or carries a unit.
    """
    require_plain(deviations, "deviations")
    if not deviations >= 0.0:
        raise IntervalError(f"deviations must be >= 0, is {deviations!r}")
    if math.isinf(deviations):
        return math.nextafter(1.0, 0.0)
    beyond = 2.0 * float(upper_tail(Interval(deviations)).sup)
    return max(0.0, math.nextafter(1.0 - beyond, 0.0))


_erfc = np.vectorize(math.erfc, otypes=[np.float64])
