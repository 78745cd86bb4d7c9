"""What is needed to divide a box: bounded intervals, and a number of pieces."""

from __future__ import annotations

import numpy as np

from eskin.errors import DesignError
from eskin.interval import Interval


def require_bounded(name: str, value: object) -> None:
    """Require one bounded interval.

    Raises:
        DesignError: It is a number, an array of intervals, empty, or unbounded.
    """
    if not isinstance(value, Interval):
        raise DesignError(f"{name}: {value!r} is no Interval; give eskin.Interval(lo, hi)")
    if value.shape != () or not np.isfinite(value.inf) or not np.isfinite(value.sup):
        raise DesignError(f"{name}: {value!r} is no bounded interval")


def require_pieces(pieces: object) -> None:
    """Require a number of pieces.

    Raises:
        DesignError: It is no whole number from 1 on.
    """
    if not (isinstance(pieces, int) and pieces >= 1):
        raise DesignError(f"pieces: {pieces!r} is no whole number from 1 on")
