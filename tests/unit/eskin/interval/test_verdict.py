"""Comparisons give three values; only a certain or impossible one is a boolean."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import IntervalError
from eskin.interval import Interval, Verdict, Verdicts

SMALL = st.integers(-4, 4).map(float)


@st.composite
def intervals(draw: st.DrawFn) -> Interval:
    lo, hi = sorted((draw(SMALL), draw(SMALL)))
    return Interval(lo, hi)


@given(a=intervals(), b=intervals())
def test_verdict_is_that_of_all_members(a: Interval, b: Interval) -> None:
    members = [
        (x, y)
        for x in np.linspace(float(a.inf), float(a.sup), 17)
        for y in np.linspace(float(b.inf), float(b.sup), 17)
    ]
    for verdict, truths in (
        (a < b, {x < y for x, y in members}),
        (a <= b, {x <= y for x, y in members}),
        (a > b, {x > y for x, y in members}),
        (a >= b, {x >= y for x, y in members}),
        (a == b, {x == y for x, y in members} | _truths_of_equality(a, b)),
        (a != b, {x != y for x, y in members} | {not truth for truth in _truths_of_equality(a, b)}),
    ):
        if verdict.certain:
            assert truths == {True}
        elif verdict.impossible:
            assert truths == {False}
        else:
            assert truths == {True, False}


def _truths_of_equality(a: Interval, b: Interval) -> set[bool]:
    """Of members that no grid may have in common: one that both have, one that another has not."""
    met = set() if a.disjoint(b) else {True}
    return met | ({False} if a.wid > 0 or b.wid > 0 else set())


def test_verdicts_combine_by_kleenes_logic() -> None:
    known = Verdicts([True, False, False], [False, False, True])
    flipped = ~known
    assert np.array_equal(flipped.certain, [False, False, True])
    assert np.array_equal(flipped.possible, [False, True, False])
    assert np.array_equal((known & flipped).impossible, [True, False, True])
    assert np.array_equal((known | flipped).certain, [True, False, True])
    assert np.array_equal((known | flipped).possible, [False, True, False])
    assert not known.any().impossible
    assert bool(known.any())
    assert not bool(known.all())
    assert known[1].possible
    with pytest.raises(IntervalError):
        Verdicts([True], [True])


def test_only_a_single_decided_verdict_is_a_boolean() -> None:
    assert Interval(1.0, 2.0) < 3.0
    assert not Interval(1.0, 2.0) > 3.0
    with pytest.raises(IntervalError):
        bool(Interval(1.0, 3.0) < 2.0)
    with pytest.raises(IntervalError):
        bool(Interval([1.0, 2.0]) < 3.0)
    with pytest.raises(IntervalError):
        bool(Interval.empty() < 1.0)
    assert repr(Interval(1.0, 3.0) < 2.0) == "Verdicts('possible')"
    assert 1.5 in Interval(1.0, 2.0)
    assert 2.5 not in Interval(1.0, 2.0)


def test_verdicts_combine_with_plain_booleans() -> None:
    known = Verdicts([True, False, False], [False, False, True])
    for both in (known & True, True & known, known & np.array([True, True, True])):
        assert np.array_equal(both.certain, known.certain)
        assert np.array_equal(both.impossible, known.impossible)
    assert np.all((known | True).certain)
    assert np.all((False & known).impossible)
    assert np.array_equal((known ^ True).certain, known.impossible)
    assert np.array_equal(Verdicts([[True, False]], [[False, True]]).any(axis=1).certain, [True])
    with pytest.raises(IntervalError):
        known & 1


def test_verdicts_have_the_codes_of_the_enum() -> None:
    known = Verdicts([[True, False, False]], [[False, False, True]])
    assert known.codes.tolist() == [[Verdict.CERTAIN, Verdict.POSSIBLE, Verdict.IMPOSSIBLE]]
    assert (Interval(1.0, 3.0) < 2.0).item() is Verdict.POSSIBLE
    with pytest.raises(IntervalError):
        known.item()
