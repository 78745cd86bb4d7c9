"""What is printed encloses what is meant."""

from __future__ import annotations

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


@given(a=FLOATS, b=FLOATS)
def test_repr_is_read_back_exactly(a: float, b: float) -> None:
    made = Interval(min(a, b), max(a, b))
    again = eval(repr(made), {"Interval": Interval})  # noqa: S307 - our own text
    assert again.equal(made)


def test_texts_are_readable() -> None:
    assert str(Interval(0.1, 0.2)) == "[0.1, 0.200001]"
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
