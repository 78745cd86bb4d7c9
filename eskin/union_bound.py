"""Coverage of a statement about many samples."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import lru_cache

from eskin.errors import IntervalError


@lru_cache(4096)
def union_coverage(*coverages: float, n: int = 1) -> float:
    """Union bound: all of n samples of each are enclosed with ``1 - n·Σ(1 - coverage)`` at least.

    Rounded down, and not below 0. It is 1 only where every coverage is: certainty stays certainty.

    Args:
        coverages: Probability with which each sample of one kind is enclosed; of none, 1.
        n: How many samples of each; of none, the statement is as good as one.

    Raises:
        IntervalError: A coverage is no probability.
    """
    for coverage in coverages:
        if not 0.0 <= coverage <= 1.0:
            raise IntervalError(f"coverage must lie in [0, 1], not {coverage!r}")
    beyond = sum(1 - Fraction(coverage) for coverage in coverages)
    exact = 1 - max(n, 1) * beyond
    if exact <= 0:
        return 0.0
    nearest = float(exact)
    return math.nextafter(nearest, 0.0) if Fraction(nearest) > exact else nearest
