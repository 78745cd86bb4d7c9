"""Every operation on intervals encloses the exact result of any members."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from eskin.errors import IntervalError
from eskin.interval import Interval

if TYPE_CHECKING:
    from collections.abc import Callable

FLOATS = st.floats(allow_nan=False, allow_infinity=False)
MODERATE = st.floats(-1e100, 1e100)
UNIT = st.floats(0.0, 1.0)


@st.composite
def interval_and_member(
    draw: st.DrawFn, ends: st.SearchStrategy[float] = FLOATS
) -> tuple[Interval, float]:
    lo, hi = sorted((draw(ends), draw(ends)))
    share = draw(UNIT)
    member = min(max(lo * (1.0 - share) + hi * share, lo), hi)
    return Interval(lo, hi), member


def encloses(result: Interval, exact: mpmath.mpf) -> bool:
    return bool(mpmath.mpf(float(result.inf)) <= exact <= mpmath.mpf(float(result.sup)))


BINARY: dict[str, tuple[Callable[[Interval, Interval], Interval], Callable[..., mpmath.mpf]]] = {
    "add": (lambda a, b: a + b, lambda x, y: x + y),
    "sub": (lambda a, b: a - b, lambda x, y: x - y),
    "mul": (lambda a, b: a * b, lambda x, y: x * y),
    "div": (lambda a, b: a / b, lambda x, y: x / y),
}


@pytest.mark.parametrize("name", BINARY)
@given(a=interval_and_member(), b=interval_and_member())
def test_arithmetic_encloses_the_exact_result(
    name: str, a: tuple[Interval, float], b: tuple[Interval, float]
) -> None:
    ours, exact = BINARY[name]
    assume(not (name == "div" and b[1] == 0.0))
    with mpmath.workprec(2200):
        assert encloses(ours(a[0], b[0]), exact(mpmath.mpf(a[1]), mpmath.mpf(b[1])))


UNARY: dict[str, tuple[Callable[[Interval], Interval], Callable[[mpmath.mpf], mpmath.mpf], float]]
UNARY = {
    "square": (Interval.square, lambda x: x * x, -1e100),
    "sqrt": (Interval.sqrt, mpmath.sqrt, 0.0),
    "exp": (Interval.exp, mpmath.exp, -700.0),
    "log": (Interval.log, mpmath.log, 5e-324),
    "neg": (Interval.__neg__, lambda x: -x, -1e100),
}


@pytest.mark.parametrize("name", UNARY)
@given(data=st.data())
def test_function_encloses_the_exact_result(name: str, data: st.DataObject) -> None:
    ours, exact, least = UNARY[name]
    most = 700.0 if name == "exp" else 1e100
    subject, member = data.draw(interval_and_member(st.floats(least, most)))
    with mpmath.workprec(300):
        assert encloses(ours(subject), exact(mpmath.mpf(member)))


@given(a=interval_and_member(MODERATE), b=interval_and_member(MODERATE))
def test_hull_holds_both_and_intersection_lies_in_both(
    a: tuple[Interval, float], b: tuple[Interval, float]
) -> None:
    hull = a[0].hull(b[0])
    assert a[0].subset(hull)
    assert b[0].subset(hull)
    if a[0].disjoint(b[0]):
        with pytest.raises(IntervalError, match="no common point"):
            a[0].intersection(b[0])
    else:
        common = a[0].intersection(b[0])
        assert common.subset(a[0])
        assert common.subset(b[0])


@given(a=interval_and_member(MODERATE))
def test_width_middle_and_magnitudes_are_of_the_interval(a: tuple[Interval, float]) -> None:
    subject, member = a
    assert subject.contains(subject.mid)
    assert float(subject.mig) <= abs(member) <= float(subject.mag)
    assert mpmath.mpf(float(subject.sup)) - mpmath.mpf(float(subject.inf)) <= mpmath.mpf(
        float(subject.wid)
    )


def test_reciprocal_of_interval_with_zero_inside_is_unbounded() -> None:
    result = Interval([-1.0, 0.0, -2.0, 0.0], [1.0, 2.0, 0.0, 0.0]).reciprocal()
    assert np.array_equal(result.inf[[0, 2, 3]], [-np.inf, -np.inf, -np.inf])
    assert np.array_equal(result.sup[[0, 1, 3]], [np.inf, np.inf, np.inf])
    assert result.inf[1] == pytest.approx(0.5)
    assert result.sup[2] == pytest.approx(-0.5)


def test_unbounded_side_survives_arithmetic() -> None:
    half = Interval(1.0, np.inf)
    assert float((half * 2.0 + 1.0).sup) == np.inf
    assert float((1.0 / half).inf) <= 0.0
    assert float((half * 0.0).sup) >= 0.0


def test_thin_intervals_stay_thin() -> None:
    x = np.linspace(0.1, 10.0, 1000)
    result = (Interval(x) * 3.0 + 1.0).sqrt().exp().log()
    assert float(np.max(result.wid / result.mid)) < 1e-13


@pytest.mark.parametrize(
    ("lo", "hi", "message"),
    [
        (1.0, 0.0, "lo > hi"),
        ([0.0, 2.0], [1.0, 1.0], r"lo > hi at index \(1,\)"),
        (float("nan"), 1.0, "NaN"),
        ([1.0, 2.0], [1.0, 2.0, 3.0], "do not fit"),
        (1j, 2j, "complex128"),
        ("a", "b", "dtype"),
    ],
)
def test_bounds_that_are_no_interval_are_named(lo: object, hi: object, message: str) -> None:
    with pytest.raises(IntervalError, match=message):
        Interval(cast("float", lo), cast("float", hi))


def test_sqrt_and_log_of_negative_name_the_place() -> None:
    with pytest.raises(IntervalError, match=r"sqrt needs lo >= 0.*index \(1,\)"):
        Interval([0.0, -1.0], [1.0, 1.0]).sqrt()
    with pytest.raises(IntervalError, match="log needs"):
        Interval(0.0, 0.0).log()


def test_numpy_arrays_and_scalars_mix_from_both_sides() -> None:
    x, array = Interval([1.0, 2.0], [1.5, 2.5]), np.array([2.0, 4.0])
    for left, right in (
        (array * x, x * array),
        (np.float64(2) + x, x + 2.0),
        (array - x, -x + array),
    ):
        assert isinstance(left, Interval)
        assert np.array_equal(left.inf, right.inf)
        assert np.array_equal(left.sup, right.sup)
    assert isinstance(array / x, Interval)


def test_documented_example_runs() -> None:
    text = (Path(__file__).parents[2] / "docs" / "intervals.md").read_text()
    code = text.split("```python\n")[1].split("```")[0]
    names: dict[str, object] = {}
    exec(compile(code, "docs/intervals.md", "exec"), names)  # noqa: S102 - our own documentation
    assert isinstance(names["frequency"], Interval)
    assert "peak" in names
