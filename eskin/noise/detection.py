"""Whether a touch is detected: certainly, possibly, or missed."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import as_interval, require_plain

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from eskin.interval import Interval


class Detection(enum.IntEnum):
    """What a threshold makes of an enclosed reading."""

    MISSED = 0
    """No member reaches the threshold."""
    POSSIBLE = 1
    """Some members reach it, some do not."""
    CERTAIN = 2
    """Every member reaches it."""


def detect(readings: Interval | ArrayLike, threshold: ArrayLike) -> NDArray[np.int8]:
    """Hold enclosed readings against a threshold; a reading on it counts as detected.

    Args:
        readings: Enclosures of the readings, or plain readings; any shape.
        threshold: In the same unit; broadcasts against them.

    Returns:
        Values of `Detection`, of the broadcast shape.

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
