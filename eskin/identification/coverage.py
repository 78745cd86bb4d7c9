"""Coverage of a q-relaxed intersection."""

from __future__ import annotations

import math
from fractions import Fraction

from eskin.errors import IdentificationError
from eskin.interval import Interval


def relaxed_coverage(coverage: float, samples: int, outliers: int) -> float:
    """Probability that at most some of many constraints are wrong, whatever makes them wrong.

    ``1 - n·(1 - c)/(q + 1)`` (Markov's inequality for their number, which is at least q + 1 where
    the statement fails); rounded down, and not below 0. For q = 0 it is the union bound.

    Args:
        coverage: c, the least probability with which each constraint holds.
        samples: n, how many constraints.
        outliers: q, how many of them may be wrong.

    Raises:
        IdentificationError: The coverage is no probability, or a number is negative.
    """
    _require(coverage, samples, outliers)
    exact = 1 - samples * (1 - Fraction(coverage)) / (outliers + 1)
    if exact <= 0:
        return 0.0
    nearest = float(exact)
    return math.nextafter(nearest, 0.0) if Fraction(nearest) > exact else nearest


def independent_coverage(coverage: float, samples: int, outliers: int) -> float:
    """The same, where constraints are wrong independently of each other.

    Chernoff's bound of the binomial distribution: more than q of n are wrong with probability
    ``exp(-n·D)`` at most, where D is the divergence of a rate of (q + 1)/n from one of 1 - c;
    rounded down. Never below `relaxed_coverage`.

    Args:
        coverage: c, the least probability with which each constraint holds.
        samples: n, how many constraints.
        outliers: q, how many of them may be wrong.

    Raises:
        IdentificationError: The coverage is no probability, or a number is negative.
    """
    least = relaxed_coverage(coverage, samples, outliers)
    wrong = outliers + 1
    if wrong > samples:
        return 1.0
    if coverage == 1.0 or wrong <= samples * (1 - Fraction(coverage)):
        return least
    rate = 1.0 - Interval(coverage)
    n, m = Interval(samples), Interval(wrong)
    exponent = m * (m / (n * rate)).log()
    if wrong < samples:
        exponent = exponent + (n - m) * ((n - m) / (n * coverage)).log()
    return max(least, float((1.0 - (-exponent).exp()).inf), 0.0)


def _require(coverage: float, samples: int, outliers: int) -> None:
    if not 0.0 <= coverage <= 1.0:
        raise IdentificationError(f"coverage must lie in [0, 1], not {coverage!r}")
    if samples < 0 or outliers < 0:
        raise IdentificationError(
            f"samples and outliers must not be negative, not {samples!r} and {outliers!r}"
        )
