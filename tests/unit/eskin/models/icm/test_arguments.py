from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eskin.errors import IntervalError
from eskin.interval import Interval
from eskin.models.icm import IcmParameters, ecfes_voltage, magfes_current, source_voltage

COIL: dict[str, Any] = {
    "amplitude": 5.0,
    "frequency": 50.0,
    "phase": -0.8,
    "coil_resistance": 2.0,
    "inductance": 1e-3,
}
CAPACITOR: dict[str, Any] = {
    "amplitude": 5.0,
    "frequency": 50.0,
    "phase": -0.8,
    "capacitor_resistance": 2419.0,
    "capacitance": 1e-6,
}


def test_nothing_flows_before_the_source_is_on() -> None:
    t = np.array([-1.0, -1e-300, -0.0, 0.0])
    for got in (magfes_current(t, **COIL), ecfes_voltage(t, **CAPACITOR)):
        assert np.all(got.inf == 0.0)
        assert np.all(got.sup == 0.0)


def test_taxels_and_times_broadcast_in_any_order() -> None:
    t = np.linspace(0.0, 20e-3, 7)
    taxels = Interval(np.linspace(0.8e-6, 1e-6, 3), np.linspace(1e-6, 1.2e-6, 3))
    column = Interval(taxels.inf[:, None], taxels.sup[:, None])
    table = ecfes_voltage(t, **{**CAPACITOR, "capacitance": column})
    turned = ecfes_voltage(t[:, None], **{**CAPACITOR, "capacitance": taxels})
    pairs = ecfes_voltage(
        np.broadcast_to(t, (3, 7)),
        **{**CAPACITOR, "capacitance": Interval(*np.broadcast_arrays(column.inf, column.sup))},
    )
    assert table.shape == pairs.shape == (3, 7)
    assert turned.shape == (7, 3)
    for i in range(3):
        alone = ecfes_voltage(t, **{**CAPACITOR, "capacitance": taxels[i]})
        for other in (table.inf[i], turned.inf[:, i], pairs.inf[i]):
            np.testing.assert_array_equal(alone.inf, other)
    assert ecfes_voltage(1e-3, **CAPACITOR).shape == ()
    assert ecfes_voltage(np.empty(0), **CAPACITOR).shape == (0,)


def test_each_element_may_have_its_own_parameters() -> None:
    rng = np.random.default_rng(2)
    t, f = rng.uniform(0.0, 20e-3, (4, 5)), rng.uniform(10.0, 100.0, 5)
    c = rng.uniform(0.5e-6, 2e-6, (4, 1))
    got = ecfes_voltage(t, **{**CAPACITOR, "frequency": f, "capacitance": c})
    for i in range(4):
        for j in range(5):
            alone = ecfes_voltage(
                t[i, j], **{**CAPACITOR, "frequency": f[j], "capacitance": c[i, 0]}
            )
            assert got.inf[i, j] == alone.inf


def test_rows_of_thin_and_wide_phase_mix() -> None:
    t = np.linspace(0.0, 20e-3, 5)
    phase = Interval([[-0.8], [-0.9]], [[-0.8], [-0.7]])
    got = magfes_current(t, **{**COIL, "phase": phase})
    thin = magfes_current(t, **COIL)
    np.testing.assert_array_equal(got.inf[0], thin.inf)
    assert np.all(got.inf[1] <= thin.inf)
    assert np.all(got.sup[1] >= thin.sup)


def test_long_rows_are_worked_on_in_blocks() -> None:
    t = np.linspace(0.0, 20e-3, 5003)
    wide = {**COIL, "inductance": Interval(0.8e-3, 1.2e-3), "coil_resistance": Interval(0.8, 1.2)}
    got = magfes_current(t, **wide)
    again = magfes_current(t[4001:], **wide)
    np.testing.assert_array_equal(got.inf[4001:], again.inf)
    np.testing.assert_array_equal(got.sup[4001:], again.sup)


def test_amplitude_may_have_either_sign() -> None:
    t = np.linspace(0.0, 20e-3, 50)
    plus = magfes_current(t, **COIL)
    minus = magfes_current(t, **{**COIL, "amplitude": -5.0})
    both = magfes_current(t, **{**COIL, "amplitude": Interval(-5.0, 5.0)})
    np.testing.assert_array_equal(minus.inf, -plus.sup)
    np.testing.assert_array_equal(both.sup, np.maximum(plus.sup, minus.sup))
    np.testing.assert_array_equal(both.inf, np.minimum(plus.inf, minus.inf))


def test_constant_source_charges_without_oscillation() -> None:
    got = ecfes_voltage(2.419e-3, **{**CAPACITOR, "frequency": 0.0, "phase": np.pi / 2})
    assert got.inf <= 5.0 * (1.0 - np.exp(-1.0)) <= got.sup
    assert got.sup - got.inf < 1e-13


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("coil_resistance", 0.0),
        ("coil_resistance", Interval(-1.0, 1.0)),
        ("inductance", -1e-3),
        ("inductance", np.inf),
        ("frequency", -50.0),
        ("phase", np.inf),
        ("amplitude", np.nan),
        ("amplitude", 1j),
    ],
)
def test_wrong_parameter_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(IntervalError, match=name):
        magfes_current(np.linspace(0.0, 1.0, 3), **{**COIL, name: value})


@pytest.mark.parametrize("time", [np.nan, np.inf, 1j, Interval(0.0, 1.0)])
def test_wrong_time_is_refused_by_name(time: Any) -> None:
    with pytest.raises(IntervalError, match="time"):
        ecfes_voltage(time, **CAPACITOR)


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(IntervalError, match="capacitance"):
        ecfes_voltage(np.zeros(3), **{**CAPACITOR, "capacitance": np.full(4, 1e-6)})


def test_parameters_as_one_object_give_the_same() -> None:
    sensor = IcmParameters(phase=-0.8, coil_resistance=2.0)
    t = np.linspace(0.0, 5e-3, 20)
    source = {name: COIL[name] for name in ("amplitude", "frequency", "phase")}
    for got, wanted in (
        (sensor.magfes_current(t), magfes_current(t, **COIL)),
        (sensor.ecfes_voltage(t), ecfes_voltage(t, **CAPACITOR)),
        (sensor.source_voltage(t), source_voltage(t, **source)),
    ):
        np.testing.assert_array_equal(got.inf, wanted.inf)
        np.testing.assert_array_equal(got.sup, wanted.sup)
