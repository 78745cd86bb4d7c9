from __future__ import annotations

import math

import mpmath
from eskin_sensor_node.firmware.arctangent import arctangent
from eskin_sensor_node.firmware.logarithm import logarithm
from eskin_sensor_node.firmware.rounding import LEAST, MOST, TWO_PI_HI, TWO_PI_LO, down, up
from hypothesis import example, given
from hypothesis import strategies as st

NORMAL = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False)


@given(NORMAL)
def test_steps_are_to_the_neighbouring_float(x: float) -> None:
    # Subnormals aside, where two floats may be passed over.
    if abs(x) < 1e-290:
        assert down(x) < x < up(x)
    else:
        assert down(x) == math.nextafter(x, -math.inf)
        assert up(x) == math.nextafter(x, math.inf)


def test_steps_at_the_ends_of_the_floats() -> None:
    assert (LEAST, MOST) == (5e-324, 1.7976931348623157e308)
    assert (down(0.0), up(0.0)) == (-LEAST, LEAST)
    assert (down(-math.inf), up(math.inf)) == (-math.inf, math.inf)
    # An overflow's exact result may still be finite.
    assert (down(math.inf), up(-math.inf)) == (MOST, -MOST)


def test_two_pi_is_enclosed_by_neighbours() -> None:
    with mpmath.workprec(200):
        assert TWO_PI_LO < 2 * mpmath.pi < TWO_PI_HI
    assert math.nextafter(TWO_PI_LO, 7.0) == TWO_PI_HI


@given(st.one_of(st.floats(5e-324, 1.7e308), st.floats(0.5, 2.0), st.floats(0.999, 1.001)))
def test_logarithm_is_enclosed_tightly(x: float) -> None:
    lo, hi = logarithm(x)
    with mpmath.workprec(200):
        exact = mpmath.log(mpmath.mpf(x))
        assert lo <= exact <= hi
        assert hi - lo <= 3e-14 * abs(float(exact)) + 1e-323


def test_logarithm_of_zero_and_infinity_is_unbounded() -> None:
    assert logarithm(0.0) == (-math.inf, -math.inf)
    assert logarithm(math.inf) == (math.inf, math.inf)


@given(st.one_of(st.floats(allow_nan=False), st.floats(-3.0, 3.0), st.floats(0.999, 1.001)))
@example(2.2250738585e-313)
def test_arctangent_is_enclosed_tightly(x: float) -> None:
    lo, hi = arctangent(x)
    with mpmath.workprec(1200):
        exact = mpmath.atan(mpmath.mpf(x))
        assert lo <= exact <= hi
        assert hi - lo <= 3e-14 * abs(float(exact)) + 1e-322


def test_arctangent_of_infinity_is_a_right_angle() -> None:
    lo, hi = arctangent(math.inf)
    with mpmath.workprec(200):
        assert lo < mpmath.pi / 2 < hi
    assert arctangent(-math.inf) == (-hi, -lo)
