"""How many violations chance may bring."""

from __future__ import annotations

import math


def binomial_quantile(trials: int, probability: float, confidence: float) -> int:
    """The least count k with P(X <= k) >= confidence, X binomial.

    Args:
        trials: Number of trials, at least 0.
        probability: Of a violation in one trial.
        confidence: Such as 1 - 1e-6.

    Returns:
        0 where the probability is 0.
    """
    if trials == 0 or probability <= 0.0:
        return 0
    if probability >= 1.0:
        return trials
    # Summed from the far tail would lose what matters near zero: the mass is added from 0 upward,
    # and the rest is compared with 1 - confidence.
    missing = 1.0 - confidence
    mass, count = 0.0, -1
    while count < trials and 1.0 - mass > missing:
        count += 1
        mass += math.exp(_log_mass(trials, count, probability))
    return count


def _log_mass(trials: int, count: int, probability: float) -> float:
    ways = math.lgamma(trials + 1) - math.lgamma(count + 1) - math.lgamma(trials - count + 1)
    return ways + count * math.log(probability) + (trials - count) * math.log1p(-probability)
