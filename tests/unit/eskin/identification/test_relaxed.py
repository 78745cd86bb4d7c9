"""The q-relaxed intersection against its definition, point by point in fractions."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import IdentificationError
from eskin.identification import relaxed_intersection
from eskin.interval import Interval

ENDS = st.integers(-4, 4).map(float) | st.sampled_from([-inf, inf])
PAIRS = (
    st.tuples(ENDS, ENDS).map(sorted).filter(lambda pair: pair not in ([inf, inf], [-inf, -inf]))
)


def hull_of_points(bounds: list[list[float]], outliers: int) -> tuple[float, float] | None:
    """Ends of the points in all but ``outliers`` intervals: each end, and between."""
    ends = sorted({Fraction(x) for pair in bounds for x in pair if abs(x) < inf} or {Fraction(0)})
    middles = [(a + b) / 2 for a, b in pairwise(ends)]
    points = sorted([*ends, *middles, ends[0] - 1, ends[-1] + 1])
    inside = [x for x in points if sum(not lo <= x <= hi for lo, hi in bounds) <= outliers]
    if not inside:
        return None
    return (
        -inf if inside[0] < ends[0] else float(inside[0]),
        inf if inside[-1] > ends[-1] else float(inside[-1]),
    )


@given(st.lists(PAIRS, min_size=1, max_size=9), st.integers(0, 9))
def test_hull_is_that_of_all_points(bounds: list[list[float]], outliers: int) -> None:
    lo, hi = np.array(bounds).T
    found = relaxed_intersection(Interval(lo, hi), outliers)
    expected = hull_of_points(bounds, outliers)
    if expected is None:
        assert bool(found.is_empty)
    else:
        assert (float(found.inf), float(found.sup)) == expected


@given(st.lists(PAIRS, min_size=1, max_size=9), st.integers(0, 8))
def test_more_outliers_enclose_more(bounds: list[list[float]], outliers: int) -> None:
    lo, hi = np.array(bounds).T
    constraints = Interval(lo, hi)
    fewer = relaxed_intersection(constraints, outliers)
    assert bool(fewer.subset(relaxed_intersection(constraints, outliers + 1)))


def test_one_wrong_interval_does_not_empty_the_set() -> None:
    constraints = Interval([0.0, 1.0, 2.0, 10.0], [3.0, 4.0, 5.0, 11.0])
    assert bool(relaxed_intersection(constraints, 0).is_empty)
    assert bool(relaxed_intersection(constraints, 1).equal(Interval(2.0, 3.0)))


def test_points_between_two_groups_are_in_the_hull() -> None:
    groups = Interval([0.0, 0.0, 9.0, 9.0], [1.0, 1.0, 10.0, 10.0])
    assert bool(relaxed_intersection(groups, 2).equal(Interval(0.0, 10.0)))


def test_rows_are_intersected_one_by_one() -> None:
    rows = Interval([[0.0, 1.0], [2.0, 5.0]], [[2.0, 3.0], [4.0, 6.0]])
    found = relaxed_intersection(rows, 0)
    assert found.inf.tolist() == [1.0, inf]
    assert found.sup.tolist() == [2.0, -inf]


@pytest.mark.parametrize(
    ("constraints", "outliers"),
    [(Interval([0.0], [1.0]), -1), (Interval.empty(2), 0), (Interval(0.0, 1.0), 0)],
)
def test_what_cannot_be_intersected_is_refused(constraints: Interval, outliers: int) -> None:
    with pytest.raises(IdentificationError):
        relaxed_intersection(constraints, outliers)
