"""Numbers become intervals exactly or outward, never to the nearest; anything else is named."""

from __future__ import annotations

from fractions import Fraction
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import IntervalError
from eskin.interval import Interval


@given(st.integers(-(2**1100), 2**1100))
def test_integer_of_any_size_is_enclosed(number: int) -> None:
    made = Interval(number)
    lo, hi = float(made.inf), float(made.sup)
    assert lo == -np.inf or Fraction(lo) <= number
    assert hi == np.inf or Fraction(hi) >= number
    if abs(number) <= 2**53:
        assert lo == hi


@pytest.mark.parametrize("dtype", [np.int64, np.uint64, np.int8])
def test_integer_arrays_are_enclosed(dtype: type[np.integer]) -> None:
    edge = np.iinfo(dtype)
    numbers = np.array([edge.min, edge.max, edge.max - 1, 1], dtype=dtype)
    made = Interval(numbers)
    for number, lo, hi in zip(numbers.tolist(), made.inf, made.sup, strict=True):
        assert Fraction(float(lo)) <= number <= Fraction(float(hi))


def test_long_double_is_enclosed() -> None:
    tenth = np.longdouble(1) / 10
    made = Interval(np.array([tenth, -tenth, np.longdouble(0.5)]))
    assert np.array_equal(made.is_singleton, [False, False, True])
    assert made.inf[0] < tenth < made.sup[0]
    assert made.inf[1] < -tenth < made.sup[1]


def test_lesser_floats_and_booleans_are_exact() -> None:
    for dtype in (np.float32, np.float16, np.bool_):
        made = Interval(np.array([0, 1], dtype=dtype))
        assert np.array_equal(made.inf, [0.0, 1.0])
        assert made.inf.dtype == np.float64


@pytest.mark.parametrize(
    ("lo", "hi", "message"),
    [
        (1.0, 0.0, "lo > hi"),
        ([0.0, 2.0], [1.0, 1.0], r"lo > hi at index \(1,\)"),
        (float("nan"), 1.0, "NaN"),
        (np.inf, np.inf, "infinity is a bound"),
        (-np.inf, -np.inf, "infinity is a bound"),
        ([1.0, 2.0], [1.0, 2.0, 3.0], "do not fit"),
        ([[1.0], [1.0, 2.0]], None, "no array of numbers"),
        (1j, 2j, "complex128"),
        ("a", "b", "dtype"),
        (None, None, "NoneType"),
        (np.ma.masked_array([1.0, 2.0], [False, True]), None, r"lo is masked at index \(1,\)"),
        (np.datetime64(0, "s"), None, "datetime64"),
        ([1, None], None, r"NoneType\) at index \(1,\)"),
        ([Interval(1.0), Interval(2.0)], None, "Interval.stack"),
    ],
)
def test_bounds_that_are_no_interval_are_named(lo: object, hi: object, message: str) -> None:
    with pytest.raises(IntervalError, match=message):
        Interval(cast("float", lo), cast("float", hi))


def test_around_and_relative_take_in_both_ends() -> None:
    made = Interval.around([1.0, 2.0], 0.1)
    assert np.all(made.contains([0.9, 1.9]))
    assert np.all(made.contains([1.1, 2.1]))
    part = Interval.relative(1000.0, 0.01)
    assert part.contains(990.0)
    assert part.contains(1010.0)
    assert Interval.relative(-5.0, 0.1).contains(-5.5)
    with pytest.raises(IntervalError, match="negative"):
        Interval.around(1.0, -0.1)
