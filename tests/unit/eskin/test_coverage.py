"""What a statement about many samples can claim is rounded down, and never too high."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from eskin_sensor_node.firmware.channel import union_coverage as firmware_coverage
from hypothesis import example, given
from hypothesis import strategies as st

from eskin.errors import IntervalError
from eskin.union_bound import union_coverage

COVERAGES = st.lists(st.floats(0.0, 1.0) | st.just(1.0) | st.just(1.0 - 2.0**-53), max_size=6)


@given(COVERAGES, st.integers(1, 10**9))
@example([1.0 - 2.0**-53] * 3, 1)
@example([], 1)
def test_union_coverage_is_the_greatest_float_not_above(coverages: list[float], n: int) -> None:
    exact = max(Fraction(0), 1 - n * sum(1 - Fraction(each) for each in coverages))
    found = union_coverage(*coverages, n=n)
    assert found >= 0.0
    assert Fraction(found) <= exact
    assert Fraction(math.nextafter(found, 2.0)) > exact
    assert (found == 1.0) == all(each == 1.0 for each in coverages)


@given(st.floats(0.0, 1.0) | st.just(1.0 - 2.0**-53), st.integers(1, 10**9))
def test_firmware_claims_no_more_and_hardly_less(coverage: float, n: int) -> None:
    found, ours = firmware_coverage(coverage, n), union_coverage(coverage, n=n)
    assert found <= ours
    assert ours - found <= 2.0**-50
    assert (found == 1.0) == (coverage == 1.0)


@pytest.mark.parametrize("coverage", [-0.1, 5, math.nan, math.inf])
def test_coverage_that_is_no_probability_is_rejected(coverage: float) -> None:
    with pytest.raises(IntervalError):
        union_coverage(0.9, coverage)
