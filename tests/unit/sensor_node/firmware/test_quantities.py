"""What the firmware calculates back, step by step, interpreted: enclosing and tight."""

from __future__ import annotations

import math

import mpmath
from eskin_sensor_node.firmware.calibration import signed_part
from eskin_sensor_node.firmware.inversion.coil import lag_bounds, modulus_bounds
from eskin_sensor_node.firmware.inversion.hygrometer import humidity_bounds
from eskin_sensor_node.firmware.inversion.pad import change_bounds, felt_bounds
from eskin_sensor_node.firmware.inversion.thermometer import celsius_bounds
from eskin_sensor_node.firmware.rounding import INFINITY
from hypothesis import given
from hypothesis import strategies as st

PART = st.floats(-2.0, 2.0)
WIDTH = st.floats(0.0, 0.1)
SHARE = st.floats(0.0, 1.0)


@given(PART, WIDTH, SHARE, PART, WIDTH, SHARE)
def test_modulus_and_lag_hold_those_of_every_current_inside(
    i: float, i_wide: float, i_share: float, q: float, q_wide: float, q_share: float
) -> None:
    i_hi, q_hi = i + i_wide, q + q_wide
    inside_i, inside_q = min(i + i_share * i_wide, i_hi), min(q + q_share * q_wide, q_hi)
    with mpmath.workprec(200):
        x, y = mpmath.mpf(inside_i), mpmath.mpf(inside_q)
        lo, hi = modulus_bounds(i, i_hi, q, q_hi)
        assert lo <= mpmath.sqrt(x * x + y * y) <= hi
        lo, hi = lag_bounds(i, i_hi, q, q_hi)
        if q <= 0.0:
            assert (lo, hi) == (-INFINITY, INFINITY)
        else:
            assert lo <= mpmath.atan(x / y) <= hi


def test_modulus_and_lag_are_tight() -> None:
    lo, hi = modulus_bounds(0.3, 0.3, 0.4, 0.4)
    assert hi - lo < 1e-15
    lo, hi = lag_bounds(-0.4, -0.4, 0.4, 0.4)
    assert hi - lo < 2e-14
    assert lo < -math.pi / 4 < hi


def test_saturated_demodulator_leaves_the_amplitude_open_and_the_lag_within_a_right_angle() -> None:
    assert modulus_bounds(0.5, INFINITY, 0.5, 0.5)[1] == INFINITY
    assert modulus_bounds(-INFINITY, 0.1, 0.5, 0.5)[1] == INFINITY
    assert modulus_bounds(0.3, INFINITY, 0.4, INFINITY)[0] > 0.49
    lo, hi = lag_bounds(0.5, INFINITY, 0.5, 0.5)
    assert math.pi / 4 - 1e-12 < lo < math.pi / 4
    assert math.pi / 2 < hi < math.pi / 2 + 1e-12


@given(
    st.floats(-1e3, 1e3),
    WIDTH,
    SHARE,
    st.floats(-0.01, 0.01),
    st.floats(0.0, 0.49),
    st.sampled_from([-1, 1]),
)
def test_change_of_permittivity_holds_every_reading_and_every_slope_inside(
    x: float, wide: float, share: float, value: float, tolerance: float, side: int
) -> None:
    inside = min(x + share * wide, x + wide)
    slope = signed_part({"slope": value, "slope_tolerance": tolerance}, "slope")
    lo, hi = change_bounds(x, x + wide, 20.0, slope)
    with mpmath.workprec(200):
        true = mpmath.mpf(value) * (1 + mpmath.mpf(side * tolerance))
        assert lo <= true * (mpmath.mpf(inside) - 20) <= hi


def test_what_is_unknown_stays_unknown() -> None:
    everything = (-INFINITY, INFINITY)
    assert change_bounds(*everything, 20.0, (0.0, 0.0)) == (0.0, 0.0)
    assert change_bounds(*everything, 20.0, (-1e-3, -1e-3)) == everything
    assert felt_bounds(*everything, (1e-3, 1e-3), (1e5, 1e5)) == everything
    assert celsius_bounds(-0.81) == (-INFINITY, -190.0)
    assert celsius_bounds(3.0) == (840.0, INFINITY)
    # A polymer that is wetter than water: broken, or noise beyond its reach.
    assert humidity_bounds(2e-10, 2e-10, (1e-10, 1e-10), (2e-3, 2e-3), 2.0) == everything
    lo, hi = humidity_bounds(1e-10, 1e-10, (1e-10, 1e-10), (2e-3, 2e-3), 2.0)
    assert 47.99 < lo < 48.0
    assert 52.0 < hi < 52.01
