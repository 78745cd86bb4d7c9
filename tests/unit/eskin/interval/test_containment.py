"""Every function of intervals holds the exact results of all members, and little else."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from eskin.interval import Interval
from tests.unit.eskin.interval.exact import (
    BINARY,
    EXTREME,
    FLOATS,
    UNARY,
    encloses,
    intervals_with_members,
    is_affordable,
    is_defined,
)

MOST_ULP = 2
SUBJECT = intervals_with_members()


@pytest.mark.parametrize("name", UNARY)
@settings(max_examples=75)
@given(subject=SUBJECT)
def test_function_encloses_the_exact_result(name: str, subject: tuple[Interval, float]) -> None:
    ours, exact = UNARY[name]
    assume(is_defined(name, subject[1]) and is_affordable(name, subject[1]))
    with mpmath.workprec(300):
        assert encloses(ours(subject[0]), exact(mpmath.mpf(subject[1])))


@pytest.mark.parametrize("name", BINARY)
@settings(max_examples=100)
@given(a=SUBJECT, b=SUBJECT)
def test_function_of_two_encloses_the_exact_result(
    name: str, a: tuple[Interval, float], b: tuple[Interval, float]
) -> None:
    ours, exact = BINARY[name]
    assume(is_defined(name, a[1], b[1]) and is_affordable(name, a[1], b[1]))
    with mpmath.workprec(2300 if name not in {"pow", "hypot"} else 300):
        assert encloses(ours(a[0], b[0]), exact(mpmath.mpf(a[1]), mpmath.mpf(b[1])))


@settings(max_examples=100)
@given(a=SUBJECT, b=SUBJECT, c=SUBJECT)
def test_fma_encloses_the_exact_result(
    a: tuple[Interval, float], b: tuple[Interval, float], c: tuple[Interval, float]
) -> None:
    with mpmath.workprec(4400):
        exact = mpmath.mpf(a[1]) * mpmath.mpf(b[1]) + mpmath.mpf(c[1])
        assert encloses(a[0].fma(b[0], c[0]), exact)


def ulps_between(lo: float, hi: float) -> int:
    """How many floats apart two floats are."""
    bits = np.array([lo, hi]).view(np.int64)
    low, high = (int(b) if b >= 0 else -(int(b) & 0x7FFFFFFFFFFFFFFF) for b in bits)
    return high - low


@pytest.mark.parametrize("name", [*UNARY, *BINARY])
@settings(max_examples=75)
@given(x=EXTREME, y=EXTREME)
def test_thin_argument_gives_at_most_two_floats(name: str, x: float, y: float) -> None:
    numbers = (x,) if name in UNARY else (x, y)
    assume(is_defined(name, *numbers) and is_affordable(name, *numbers))
    if name in UNARY:
        result = UNARY[name][0](Interval(x))
    else:
        result = BINARY[name][0](Interval(x), Interval(y))
    with mpmath.workprec(300 if name in {*UNARY, "pow", "hypot"} else 2300):
        function = UNARY[name][1] if name in UNARY else BINARY[name][1]
        exact = function(*map(mpmath.mpf, numbers))
    lo, hi = float(result.inf), float(result.sup)
    if np.isinf(lo) or np.isinf(hi):
        assert abs(exact) > 1.7e308 or name == "tan"
        return
    assert ulps_between(lo, float(exact)) <= MOST_ULP
    assert ulps_between(float(exact), hi) <= MOST_ULP


@pytest.mark.parametrize("name", ["add", "sub", "mul", "div"])
@settings(max_examples=100)
@given(x=EXTREME, y=EXTREME)
def test_arithmetic_is_tightest(name: str, x: float, y: float) -> None:
    assume(is_defined(name, x, y))
    ours, exact = BINARY[name]
    result = ours(Interval(x), Interval(y))
    with mpmath.workprec(2300):
        truth = exact(mpmath.mpf(x), mpmath.mpf(y))
        assert encloses(result, truth)
        lo, hi = float(result.inf), float(result.sup)
        assert lo == hi == truth or math.nextafter(lo, math.inf) == hi != truth != lo


@pytest.mark.parametrize("name", UNARY)
@settings(max_examples=100)
@given(a=EXTREME, b=EXTREME, c=EXTREME)
def test_function_is_isotonic_and_the_hull_of_its_parts(
    name: str, a: float, b: float, c: float
) -> None:
    lo, middle, hi = sorted((a, b, c))
    ours = UNARY[name][0]
    whole, left, right = (
        ours(Interval(lo, hi)),
        ours(Interval(lo, middle)),
        ours(Interval(middle, hi)),
    )
    assert left.subset(whole)
    assert right.subset(whole)
    assert whole.subset(left.convex_hull(right)) or name in {
        "recip",
        "pown-2",
        "pown-3",
        "rootn-5",
        "tan",
    }


@pytest.mark.parametrize("name", ["exp", "expm1", "exp2", "exp10", "sinh", "cosh"])
@pytest.mark.parametrize("x", [1100.0, 1e300])
def test_what_no_float_holds_is_beyond_the_greatest(name: str, x: float) -> None:
    result = UNARY[name][0](Interval(x))
    assert (float(result.inf), float(result.sup)) == (np.finfo(float).max, np.inf)


def test_odd_function_overflows_alike_on_both_sides() -> None:
    result = Interval([711.0, -711.0]).sinh()
    assert list(result.inf) == [np.finfo(float).max, -np.inf]
    assert list(result.sup) == [np.inf, -np.finfo(float).max]


@pytest.mark.parametrize("name", BINARY)
@settings(max_examples=100)
@given(a=EXTREME, b=EXTREME, c=EXTREME, other=SUBJECT)
def test_function_of_two_is_isotonic(
    name: str, a: float, b: float, c: float, other: tuple[Interval, float]
) -> None:
    lo, middle, hi = sorted((a, b, c))
    ours = BINARY[name][0]
    whole = ours(Interval(lo, hi), other[0])
    assert ours(Interval(lo, middle), other[0]).subset(whole)
    assert ours(Interval(middle, hi), Interval(other[1])).subset(whole)


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
@settings(max_examples=150)
@given(
    x=st.one_of(
        FLOATS,
        st.floats(-(2.0**48), 2.0**48),
        st.floats(-10.0, 10.0),
        st.integers(-(2**48), 2**48).map(lambda quarters: quarters * 0.5 * np.pi),
    )
)
def test_angle_is_at_most_a_float_from_the_tightest_bounds(name: str, x: float) -> None:
    ours, exact = UNARY[name]
    result = ours(Interval(x))
    with mpmath.workprec(300):
        truth = exact(mpmath.mpf(x))
        near = float(truth)
        above = near if mpmath.mpf(near) >= truth else float(np.nextafter(near, np.inf))
        below = near if mpmath.mpf(near) <= truth else float(np.nextafter(near, -np.inf))
    assert 0 <= ulps_between(above, float(result.sup)) <= 1
    assert 0 <= ulps_between(float(result.inf), below) <= 1


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_turning_points_are_found_at_every_magnitude(name: str) -> None:
    ours, exact = UNARY[name]
    random = np.random.default_rng(3)
    turns = np.concatenate([random.integers(-50, 50, 300), random.integers(-(2**40), 2**40, 300)])
    with mpmath.workprec(200):
        for turn in turns.tolist():
            point = float((mpmath.mpf(turn) / 2 + (name == "sin") * mpmath.mpf(1) / 2) * mpmath.pi)
            for below, above in ((1e-3, 1e-3), (0.0, 1e-3), (1e-3, 0.0), (1.0, 2.0)):
                subject = Interval(point - below, point + above)
                for member in np.linspace(float(subject.inf), float(subject.sup), 9):
                    assert encloses(ours(subject), exact(mpmath.mpf(member)))


def test_sum_is_exact_to_a_rounding_and_encloses() -> None:
    random = np.random.default_rng(5)
    for size in (0, 1, 2, 1000):
        terms = random.standard_normal(size) * 10.0 ** random.integers(-12, 12, size)
        result = Interval(terms).sum()
        with mpmath.workprec(400):
            exact = mpmath.fsum([mpmath.mpf(float(term)) for term in terms])
        assert encloses(result, exact)
        assert ulps_between(float(result.inf), float(result.sup)) <= 2
    assert Interval([1e308, 1e308], [1e308, 1e308]).sum().inf == np.finfo(float).max
    assert Interval([1.0, -np.inf], [np.inf, 5.0]).sum().is_entire
    rows = Interval(np.arange(6.0).reshape(2, 3))
    assert np.array_equal(rows.sum(axis=0).sup, [3.0, 5.0, 7.0])
    assert np.array_equal(rows.sum(axis=1).inf, [3.0, 12.0])
