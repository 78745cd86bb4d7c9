"""Detection of a touch by a threshold."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import as_interval, require_plain

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from eskin.interval import Interval


def detect(readings: Interval | ArrayLike, threshold: ArrayLike) -> NDArray[np.int8]:
    """Compare enclosed readings with a threshold; a reading equal to it is detected.

    Args:
        readings: Enclosures of the readings, or plain readings; any shape.
        threshold: In the same unit; broadcasts against them.

    Returns:
        Values of `Verdict`, of the broadcast shape.

    Raises:
        IntervalError: A threshold is no number, a reading is empty, one carries a unit, or shapes
            do not fit.
    """
    enclosed = as_interval(readings)
    require_plain(threshold, "threshold")
    try:
        limit = np.asarray(threshold, dtype=np.float64)
    except ValueError as error:
        raise IntervalError(f"threshold: {error}") from error
    if np.isnan(limit).any():
        raise IntervalError("threshold is NaN; give a number in the unit of the readings")
    if np.any(enclosed.is_empty):
        raise IntervalError("readings hold an empty interval, which no threshold can judge")
    try:
        certain, possible = enclosed.inf >= limit, enclosed.sup >= limit
    except ValueError as error:
        raise IntervalError(f"readings and threshold do not fit each other: {error}") from error
    return np.add(certain, possible, dtype=np.int8)
