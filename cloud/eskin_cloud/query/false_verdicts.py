"""How many verdicts a year are false, as an expected number at most."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Collection

YEAR: Final = 31_557_600_000_000_000
"""A Julian year of 365.25 d, in ns."""


class SampledChannel(NamedTuple):
    """How a channel of a formula is sampled.

    Attributes:
        step: The least time between two samples, ns.
        error: The greatest time error, ns.
        coverage: The least coverage of a sample.
        reach: How long the stretch of time is that the formula looks at, ns.
    """

    step: int
    error: int
    coverage: float
    reach: int

    @property
    def most_samples(self) -> int:
        """Samples that may hold within the horizon of one instant, at most.

        The first moments of all but one of them lie within the horizon and the errors of time
        around it; that one holds since before it.
        """
        return (self.reach + 2 * self.error) // self.step + 2


def false_a_year(channels: Collection[SampledChannel]) -> float:
    """Expected number of false verdicts a year, at most, with one at each sample of each channel.

    A verdict is right where all samples are that may hold within its horizon: so it is false with
    a probability of Σ(1 - c) over them at most. Expected numbers add up, whatever depends on what.
    Rounded up; 0 where every coverage is 1.
    """
    beyond = sum((1 - Fraction(each.coverage)) * each.most_samples for each in channels)
    verdicts = sum(Fraction(YEAR, each.step) for each in channels)
    exact = verdicts * min(beyond, Fraction(1))
    nearest = float(exact)
    return math.nextafter(nearest, math.inf) if Fraction(nearest) < exact else nearest
