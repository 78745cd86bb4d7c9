"""Coverage of a statement about many samples."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import lru_cache


@lru_cache(4096)
def union_coverage(coverage: float, n: int) -> float:
    """Union bound: all of n samples are enclosed with ``1 - n·(1 - coverage)`` at least.

    Rounded down, and not below 0; certainty stays certainty.

    Args:
        coverage: Probability with which each sample is enclosed.
        n: How many samples; of none, the statement is as good as one.
    """
    if coverage == 1.0 or n == 0:
        return coverage
    exact = 1 - n * (1 - Fraction(coverage))
    if exact <= 0:
        return 0.0
    nearest = float(exact)
    return math.nextafter(nearest, 0.0) if Fraction(nearest) > exact else nearest
