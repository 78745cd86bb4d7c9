"""Tails of the normal distribution hold what mpmath finds, and no deviation gives certainty."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from eskin.errors import IntervalError
from eskin.interval import Interval
from eskin.noise import coverage_within, upper_tail
from eskin.union_bound import union_coverage


def exact_tail(deviations: float) -> mpmath.mpf:
    """In 200 bits, as the caller's context has them."""
    return mpmath.erfc(mpmath.mpf(deviations) / mpmath.sqrt(2)) / 2


@given(st.floats(-45.0, 45.0), st.floats(0.0, 3.0))
@example(38.5, 0.0)  # the tail is a subnormal number
@example(40.0, 1.0)  # less than every float
@example(-9.0, 0.0)  # all but certain
def test_tail_is_enclosed(deviations: float, width: float) -> None:
    given_ = Interval(deviations, deviations + width)
    found = upper_tail(given_)
    with mpmath.workprec(200):
        most, least = exact_tail(deviations), exact_tail(float(given_.sup))
        assert mpmath.mpf(float(found.inf)) <= least
        assert mpmath.mpf(float(found.sup)) >= most
        assert mpmath.mpf(float(found.sup)) - most <= most * 1e-11 + 1e-319
        assert least - mpmath.mpf(float(found.inf)) <= least * 1e-11 + 1e-319


def test_tail_keeps_the_shape() -> None:
    assert upper_tail(Interval(np.zeros((2, 3)))).shape == (2, 3)
    assert upper_tail(Interval(np.zeros((0, 3)))).shape == (0, 3)
    assert 0.5 in upper_tail(Interval(0.0))
    assert np.all(upper_tail(Interval(-math.inf, math.inf)).contains(np.array([0.0, 1.0])))


@given(st.floats(0.0, 45.0))
@example(8.3)
@example(9.0)
def test_coverage_within_is_rounded_down(deviations: float) -> None:
    found = coverage_within(deviations)
    assert 0.0 <= found < 1.0
    with mpmath.workprec(200):
        exact = 1 - 2 * exact_tail(deviations)
        assert mpmath.mpf(found) <= exact
        assert exact - mpmath.mpf(found) < 1e-11


@pytest.mark.parametrize("deviations", [9.0, 40.0, math.inf])
def test_only_a_hard_bound_gives_certainty(deviations: float) -> None:
    coverage = coverage_within(deviations)
    assert coverage < 1.0
    assert union_coverage(coverage, n=10**6) < 1.0 - 1e-10


@pytest.mark.parametrize("deviations", [-1.0, -math.inf, math.nan])
def test_number_of_deviations_that_is_none_is_rejected(deviations: float) -> None:
    with pytest.raises(IntervalError):
        coverage_within(deviations)
