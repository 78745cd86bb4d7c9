"""Whether a process's memory grows: the slope of what was sampled, as an interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from scipy.stats import theilslopes

if TYPE_CHECKING:
    from collections.abc import Sequence

BUCKETS: Final = 20
_CONFIDENCE: Final = 0.95
_WARM_UP: Final = 0.25
"""Share of the time in which caches fill; it is left out."""
LEAST: Final = 54
"""Fewest samples: two in each stretch after the warm-up."""
_FLAT: Final = 0.05
"""Growth an hour, as a share of the memory used, up to which memory is called flat."""


@dataclass(frozen=True, slots=True)
class Trend:
    """Growth an hour as a share of the mean, in the interval ``[lo, hi]`` with 95 % confidence.

    It is Sen's slope between the medians of twenty stretches of time: samples that follow each
    other closely are not independent, and a burst leaves a heap higher for minutes, which is no
    trend. A line of least squares takes such a step for a part of one: it called leaks flat under
    steps, and memory that does not grow undecided, more often. Steps that last longer than a
    stretch still make the interval less sure than it says.

    Attributes:
        mean: Mean memory after the warm-up, bytes.
        lo: Least growth.
        hi: Most growth.
    """

    mean: float
    lo: float
    hi: float

    @classmethod
    def of(cls, seconds: Sequence[float], used: Sequence[float]) -> Self:
        """Fit samples.

        Args:
            seconds: When they were taken, ascending.
            used: Bytes.

        Raises:
            ValueError: There are fewer than `LEAST`.
        """
        if len(seconds) < LEAST:
            raise ValueError(f"{len(seconds)} samples are too few; at least {LEAST} are needed")
        warm = int(len(seconds) * _WARM_UP)
        x = np.array([part.mean() for part in np.array_split(np.array(seconds[warm:]), BUCKETS)])
        y = np.array([np.median(part) for part in np.array_split(np.array(used[warm:]), BUCKETS)])
        mean = float(y.mean())
        _, _, lo, hi = theilslopes(y, x, _CONFIDENCE)
        hourly = 3600.0 / mean
        return cls(mean, float(lo) * hourly, float(hi) * hourly)

    @property
    def verdict(self) -> str:
        """``flat`` or ``grows`` where that is certain, otherwise ``undecided``."""
        if self.hi <= _FLAT:
            return "flat"
        return "grows" if self.lo > _FLAT else "undecided"
