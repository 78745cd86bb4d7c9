"""The audit allows as many violations as chance may bring, and no more."""

from __future__ import annotations

import pytest
from scipy.stats import binom

from eskin.demo.audit.channel import binomial_quantile

CONFIDENCE = 1 - 1e-6


@pytest.mark.parametrize("trials", [1, 10, 1000, 250_000])
@pytest.mark.parametrize("probability", [1e-12, 1.97e-9, 1e-6, 1e-4, 0.0027, 0.3])
def test_quantile_agrees_with_scipy(trials: int, probability: float) -> None:
    ours = binomial_quantile(trials, probability, CONFIDENCE)
    theirs = int(binom.ppf(CONFIDENCE, trials, probability))
    assert abs(ours - theirs) <= 1


def test_certain_coverage_allows_no_violation() -> None:
    assert binomial_quantile(10**9, 0.0, CONFIDENCE) == 0


def test_no_trial_allows_no_violation() -> None:
    assert binomial_quantile(0, 0.5, CONFIDENCE) == 0


def test_no_coverage_allows_all() -> None:
    assert binomial_quantile(7, 1.0, CONFIDENCE) == 7
