"""Where, clip, cumsum, prod and diff give what members give, and hardly more."""

from __future__ import annotations

import itertools
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from eskin.errors import IntervalError
from eskin.interval import Interval, Verdicts
from tests.unit.eskin.interval.exact import EXTREME

SMALL = st.integers(-3, 3).map(float)


def rows(numbers: st.SearchStrategy[float], most: int) -> st.SearchStrategy[list[list[float]]]:
    pair = st.tuples(numbers, numbers).map(sorted)
    return st.lists(pair, min_size=1, max_size=most)


def of(pairs: list[list[float]]) -> Interval:
    return Interval([lo for lo, _ in pairs], [hi for _, hi in pairs])


def is_tight(bound: float, exact: Fraction, direction: float, steps: int) -> bool:
    """Whether a bound is on its side of a number, and at most so many floats away."""
    if not np.isfinite(bound):
        return (bound > 0) == (direction > 0) and abs(exact) > Fraction(1.7e308)
    near = bound
    for _ in range(steps):
        near = float(np.nextafter(near, -direction * np.inf))
    if direction > 0:
        return Fraction(bound) >= exact and (not np.isfinite(near) or Fraction(near) < exact)
    return Fraction(bound) <= exact and (not np.isfinite(near) or Fraction(near) > exact)


@given(rows(EXTREME, 8))
@example([[1e16, 1e16], [1.0, 1.0], [-1e16, -1e16], [1.0, 1.0]])
@example([[1.7e308, 1.7e308], [1.7e308, 1.7e308], [-1.7e308, -1.7e308]])
@example([[-1.7e308, -1.7e308], [-1.7e308, 1.0], [0.5, 1.0]])
def test_cumsum_is_the_sum_up_to_each(pairs: list[list[float]]) -> None:
    with np.errstate(all="ignore"):
        found: Any = np.cumsum(of(pairs))
        lows = list(itertools.accumulate(Fraction(lo) for lo, _ in pairs))
        highs = list(itertools.accumulate(Fraction(hi) for _, hi in pairs))
        large = max(max(map(abs, lows)), max(map(abs, highs))) > Fraction(1.7e308)
        for k, (low, high) in enumerate(zip(lows, highs, strict=True)):
            inf, sup = float(found.inf[k]), float(found.sup[k])
            assert inf < np.inf
            assert sup > -np.inf
            assert inf == -np.inf or Fraction(inf) <= low
            assert sup == np.inf or Fraction(sup) >= high
            if not large:
                assert is_tight(inf, low, -1.0, 2)
                assert is_tight(sup, high, 1.0, 2)


@given(rows(SMALL, 5))
def test_whole_numbers_give_exact_ranges(pairs: list[list[float]]) -> None:
    x = of(pairs)
    members = list(itertools.product(*pairs))
    products = [float(np.prod(member)) for member in members]
    found: Any = np.prod(x)
    assert (found.inf, found.sup) == (min(products), max(products))
    for n in range(3):
        exact = np.array([np.diff(member, n=n) for member in members])
        differences: Any = np.diff(x, n=n)
        assert np.array_equal(differences.inf, exact.min(axis=0))
        assert np.array_equal(differences.sup, exact.max(axis=0))


@given(rows(EXTREME, 9))
def test_prod_encloses_and_stays_tight(pairs: list[list[float]]) -> None:
    with np.errstate(all="ignore"):
        found = of(pairs).prod()
    low = high = Fraction(1)
    for lo, hi in pairs:
        ends = [end * Fraction(side) for end in (low, high) for side in (lo, hi)]
        low, high = min(ends), max(ends)
    assert found.inf == -np.inf or Fraction(float(found.inf)) <= low
    assert found.sup == np.inf or Fraction(float(found.sup)) >= high
    if all(1e-30 < abs(end) < 1e30 for pair in pairs for end in pair):
        for bound, exact in ((found.inf, low), (found.sup, high)):
            assert abs(Fraction(float(bound)) - exact) <= abs(exact) * 16 / 2**53


@given(a=rows(SMALL, 1), x=rows(SMALL, 1), y=rows(SMALL, 1), limit=SMALL)
def test_where_encloses_the_choice_of_each_member(
    a: list[list[float]], x: list[list[float]], y: list[list[float]], limit: float
) -> None:
    found: Any = np.where(of(a) > limit, of(x), of(y))
    members = np.unique([*a[0], limit, limit + 0.5, limit - 0.5])
    inside = members[(members >= a[0][0]) & (members <= a[0][1])]
    chosen = [pair[0] for pair, taken in ((x, inside > limit), (y, inside <= limit)) if taken.any()]
    assert found.inf[0] == min(lo for lo, _ in chosen)
    assert found.sup[0] == max(hi for _, hi in chosen)


@given(x=rows(SMALL, 1), lo=rows(SMALL, 1), hi=rows(SMALL, 1))
def test_clip_is_numpys_of_each_member(
    x: list[list[float]], lo: list[list[float]], hi: list[list[float]]
) -> None:
    members = [float(np.clip(*each)) for each in itertools.product(x[0], lo[0], hi[0])]
    found: Any = np.clip(of(x), of(lo), of(hi))
    assert (found.inf[0], found.sup[0]) == (min(members), max(members))
    low, high = lo[0][0], hi[0][1]
    assert np.all(found.equal(of(x).clip(of(lo), of(hi))))
    only: Any = np.clip(of(x), low, None)
    assert np.all(only.equal(of(x).greater(low)))
    named: Any = np.clip(of(x), max=high)
    assert np.all(named.equal(of(x).lesser(high)))


def test_where_takes_booleans_answers_of_plain_values_and_broadcasts() -> None:
    x = Interval([1.0, 2.0, 3.0], [2.0, 4.0, 5.0])
    plain: Any = np.where(np.array([True, False, True]), x, 0.0)
    assert plain.inf.tolist() == [1.0, 0.0, 3.0]
    chosen: Any = np.where(x > 2.5, 1.0, -1.0)
    assert (chosen.inf.tolist(), chosen.sup.tolist()) == ([-1.0, -1.0, 1.0], [-1.0, 1.0, 1.0])
    wide: Any = np.where(Verdicts([[True], [False]], [[False], [True]]), x, Interval(9.0))
    assert wide.shape == (2, 3)
    nothing: Any = np.where(x > 2.5, x, Interval.empty())
    assert nothing.is_empty.tolist() == [True, False, False]
    with pytest.raises(IntervalError, match="fit"):
        np.where(x > 2.5, x, Interval([1.0, 2.0]))
    with pytest.raises(IntervalError, match="interval"):
        np.where(x, x, x)


def test_axes_are_numpys() -> None:
    values = np.arange(24.0).reshape(2, 3, 4)
    x = Interval(values)
    for axis in (None, 0, 1, 2, -1):
        total: Any = np.cumsum(x, axis=axis)
        product: Any = np.prod(x + 1.0, axis=axis)
        assert np.array_equal(total.inf, np.cumsum(values, axis=axis))
        assert np.allclose(product.inf, np.prod(values + 1.0, axis=axis), rtol=1e-14)
        assert product.shape == np.prod(values, axis=axis).shape
        if axis is not None:
            step: Any = np.diff(x, axis=axis)
            assert np.array_equal(step.sup, np.diff(values, axis=axis))
    assert x.prod(axis=(0, 2), keepdims=True).shape == (1, 3, 1)
    assert float(Interval([]).prod().inf) == 1.0
    assert Interval([]).cumsum().shape == (0,)
    assert Interval([1.0]).diff().shape == (0,)
    with pytest.raises(IntervalError, match="axis 3"):
        x.cumsum(3)
    with pytest.raises(IntervalError, match="axis 3"):
        x.diff(axis=3)
    with pytest.raises(IntervalError, match="0 times"):
        x.diff(-1)


def test_an_empty_interval_makes_all_sums_after_it_empty() -> None:
    x = Interval.concatenate([Interval([1.0, 2.0]), Interval.empty(1), Interval([3.0])])
    assert x.cumsum().is_empty.tolist() == [False, False, True, True]
    assert x.prod().is_empty


def test_all_and_any_of_answers_are_answers() -> None:
    x = Interval([1.0, 2.0], [2.0, 4.0])
    every: Any = np.all(x > 0.5)
    some: Any = np.any(x > 3.0)
    assert isinstance(every, Verdicts)
    assert every.certain
    assert some.possible
