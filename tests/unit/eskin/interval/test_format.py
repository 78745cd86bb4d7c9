"""What is printed encloses what is meant."""

from __future__ import annotations

import math
import re
from decimal import (
    ROUND_CEILING,
    ROUND_FLOOR,
    ROUND_HALF_EVEN,
    ROUND_UP,
    Context,
    FloatOperation,
    Inexact,
    localcontext,
)
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from eskin.errors import IntervalError
from eskin.interval import Interval

FLOATS = st.floats(allow_nan=False, allow_infinity=False)


@given(a=FLOATS, b=FLOATS, digits=st.integers(0, 12), kind=st.sampled_from("efg"))
def test_printed_decimals_enclose(a: float, b: float, digits: int, kind: str) -> None:
    made = Interval(min(a, b), max(a, b))
    text = f"{made:.{digits}{kind}}"
    lo, hi = (Fraction(part) for part in text.strip("[]").split(", "))
    assert lo <= Fraction(float(made.inf))
    assert hi >= Fraction(float(made.sup))


@settings(max_examples=200)
@given(
    a=FLOATS,
    digits=st.one_of(st.integers(0, 60), st.integers(300, 999)),
    kind=st.sampled_from("efg"),
    prec=st.integers(1, 60),
    rounding=st.sampled_from([ROUND_FLOOR, ROUND_CEILING, ROUND_HALF_EVEN, ROUND_UP]),
    reach=st.sampled_from([3, 999_999]),
)
@example(a=0.1, digits=30, kind="g", prec=28, rounding=ROUND_HALF_EVEN, reach=999_999)
@example(a=1.23456789, digits=6, kind="g", prec=4, rounding=ROUND_HALF_EVEN, reach=999_999)
@example(a=1.5e300, digits=999, kind="f", prec=28, rounding=ROUND_HALF_EVEN, reach=999_999)
def test_printed_decimals_enclose_in_any_decimal_context(
    a: float, digits: int, kind: str, prec: int, rounding: str, reach: int
) -> None:
    plain = f"{Interval(a):.{digits}{kind}}"
    with localcontext(Context(prec, rounding, -reach, reach, traps=[Inexact, FloatOperation])):
        text = f"{Interval(a):.{digits}{kind}}"
    lo, hi = (Fraction(part) for part in text.strip("[]").split(", "))
    assert lo <= Fraction(a) <= hi
    assert text == plain


def decimals(text: str) -> tuple[Fraction, Fraction]:
    lo, hi = (Fraction(part) for part in text.strip("[]").split(", "))
    return lo, hi


@given(a=FLOATS, b=FLOATS)
@example(a=-1.7e308, b=1.7e308)
@example(a=0.0, b=5e-324)
@example(a=0.1, b=0.2)
def test_plain_text_encloses_with_six_digits_or_more(a: float, b: float) -> None:
    made = Interval(min(a, b), max(a, b))
    lo, hi = decimals(str(made))
    inf, sup = Fraction(float(made.inf)), Fraction(float(made.sup))
    assert lo <= inf
    assert sup <= hi
    assert inf - lo <= abs(inf) / 10**5
    assert hi - sup <= abs(sup) / 10**5


@given(a=st.floats(1e-300, 1e300), share=st.floats(0.0, 1e-2), sign=st.sampled_from([-1.0, 1.0]))
@example(a=1.0, share=2.0**-52, sign=1.0)
@example(a=0.1, share=0.0, sign=1.0)
def test_thin_interval_looks_thin(a: float, share: float, sign: float) -> None:
    ends = sorted([sign * a, sign * a * (1.0 + share)])
    made = Interval(*ends)
    lo, hi = decimals(str(made))
    width, most = Fraction(ends[1]) - Fraction(ends[0]), Fraction(2, 10**16) * Fraction(a)
    # Two digits of the width are right; a float has no more than 17.
    assert hi - lo <= width * Fraction(12, 10) + most


@given(a=FLOATS)
def test_number_is_read_back_from_both_bounds(a: float) -> None:
    lo, hi = (float(part) for part in str(Interval(a)).strip("[]").split(", "))
    assert lo in {a, math.nextafter(a, -math.inf)}
    assert hi in {a, math.nextafter(a, math.inf)}


@given(st.lists(st.tuples(FLOATS, FLOATS).map(sorted), min_size=1, max_size=5))
def test_repr_of_many_is_read_back_exactly(pairs: list[list[float]]) -> None:
    made = Interval([lo for lo, _ in pairs], [hi for _, hi in pairs])
    again = eval(repr(made), {"Interval": Interval, "array": np.array})  # noqa: S307 - our own text
    assert np.all(again.equal(made))


def test_many_are_laid_out_as_numpy_lays_out_arrays() -> None:
    made = Interval(np.arange(40.0).reshape(4, 10), 50.5)
    lines = str(made).splitlines()
    assert all(len(line) <= np.get_printoptions()["linewidth"] for line in lines)
    assert len({line.rindex(",") for line in lines if line.count(",") == 10}) <= 1
    with np.printoptions(threshold=10, edgeitems=1):
        assert str(made).count(",") == 4
    assert str(Interval([])) == "[]"


@given(a=FLOATS, b=FLOATS)
def test_repr_is_read_back_exactly(a: float, b: float) -> None:
    made = Interval(min(a, b), max(a, b))
    again = eval(repr(made), {"Interval": Interval})  # noqa: S307 - our own text
    assert again.equal(made)


def test_texts_are_readable() -> None:
    assert str(Interval(0.1, 0.2)) == "[0.1, 0.200001]"
    assert str(Interval(0.1)) == "[0.1, 0.10000000000000001]"
    assert str(Interval(62.5)) == "[62.5, 62.5]"
    assert str(Interval(1234567.0, 1234567.5)) == "[1234567, 1234567.5]"
    assert str(Interval(-np.inf, 0.25)) == "[-inf, 0.25]"
    assert f"{Interval(62.41, 63.69):.3g}" == "[62.4, 63.7]"
    assert f"{Interval(0.1, 2.341e-1):.2e}" == "[1.00e-1, 2.35e-1]"
    assert f"{Interval(-1.25, 1.25):.1f}" == "[-1.3, 1.3]"
    assert str(Interval.empty()) == "[empty]"
    assert str(Interval.entire()) == "[-inf, inf]"
    assert repr(Interval.empty()) == "Interval.empty()"
    assert str(Interval([1.0, 2.0], [1.5, 2.5])) == "[[1, 1.5] [2, 2.5]]"
    assert repr(Interval([1.0])).startswith("Interval(lo=array")
    long = str(Interval(np.zeros(5000)))
    assert "..." in long
    assert len(re.findall(r"\[0, 0\]", long)) == 6
    with pytest.raises(IntervalError, match="is none of"):
        f"{Interval(1.0):d}"
