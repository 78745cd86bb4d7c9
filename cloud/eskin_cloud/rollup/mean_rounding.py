"""Sums as means in whole quanta, and back: what was a mean stays the same mean.

Each time a chunk changes, all sums in it are written anew. So a sum that is a whole number of
quanta times its count must give the same quanta again, or bounds would drift apart.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.kernels.jit import kernel
from eskin.kernels.outward_rounding import mul_down

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_cloud.rollup.aggregates import Integers


@kernel
def multiply_down(n: Integers, means: Floats) -> Floats:
    """Lower bounds of counts times means."""
    sums = np.empty(n.size)
    for k in range(n.size):
        sums[k] = means[k] if np.isinf(means[k]) else mul_down(np.float64(n[k]), means[k])
    return sums


@kernel
def divide_down(sums: Floats, n: Integers, exponent: int) -> Floats:
    """Divide sums by counts, rounded down to quanta of ``2^exponent``.

    A mean times its count is no more than the sum.
    """
    means, quantum = np.empty(n.size), 2.0**exponent
    for k in range(n.size):
        count = np.float64(n[k])
        mean = sums[k] / count
        if not np.isinf(mean):
            scaled = mean * 2.0**-exponent
            if abs(scaled) < 2.0**52:
                mean = (np.floor(scaled) + 1.0) * quantum
            for _ in range(3):
                if mul_down(count, mean) <= sums[k]:
                    break
                mean = min(mean - quantum, np.nextafter(mean, -np.inf))
        means[k] = mean
    return means
