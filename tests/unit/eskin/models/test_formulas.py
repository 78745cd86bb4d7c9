"""Thin parameters give the plain formula's value within a few floats; resonance is bracketed."""

from __future__ import annotations

import numpy as np
import pytest

from eskin import models
from eskin.interval import Interval
from tests.unit.eskin.models.cases import CASES

ULP = 2.0**-52
FLOATS = dict.fromkeys(CASES, 16) | {"energy_flow": 600}
"""How many floats a thin result may be wide."""
CANCELLING = {
    "alternating_capacitance_paper",
    "alternating_current",
    "alternating_current_of_eq_7",
    "alternating_current_paper",
    "proximity",
    "resonance",
}


@pytest.mark.parametrize("name", [name for name in CASES if name not in CANCELLING])
def test_thin_parameters_give_a_few_floats(name: str) -> None:
    case = CASES[name]
    generator = np.random.default_rng(50)
    box = {key: Interval(value.inf) for key, value in case.boxes(generator, 1000).items()}
    for result, value in case.evaluate(box).items():
        width = value.sup - value.inf
        assert np.all(width <= FLOATS[name] * 2 * ULP * value.mag + 1e-318), result


def test_thin_capacitance_holds_the_plain_formula() -> None:
    generator = np.random.default_rng(51)
    er, area, distance = (generator.uniform(1.0, 2.0, 10_000) for _ in range(3))
    plain = 8.8541878188e-12 * er * area / distance
    found = models.capacitance(
        relative_permittivity=er, area=area, distance=distance, vacuum_permittivity=8.8541878188e-12
    )
    assert np.all((found.inf <= plain) & (plain <= found.sup))
    assert np.all(found.sup - found.inf <= 12 * np.spacing(plain))


def test_thin_chain_holds_the_plain_formula_within_a_few_floats() -> None:
    times = np.linspace(0.0, 1.0, 10_001)
    plain_c = 10e-12 + 90e-12 * (0.5 + 0.5 * np.sin(4.0 * np.pi * times))
    plain_f = 1.0 / (2.0 * np.pi * 1e3 * plain_c)
    plain_i = 1e-3 * 10e-12 / plain_c
    found = models.capacitive_chain(
        times,
        minimum_capacitance=10e-12,
        maximum_capacitance=100e-12,
        resistance=1e3,
        transconductance=1e-3,
    )
    for value, plain in (
        (found.capacitance, plain_c),
        (found.frequency, plain_f),
        (found.current, plain_i),
    ):
        assert np.all(np.abs(value.mid - plain) <= 64 * np.spacing(plain))


def test_thin_proximity_holds_the_plain_formula_within_a_few_floats() -> None:
    times = np.linspace(0.0, 1.0, 10_001)
    distance = 0.02 + 0.01 * np.sin(2.0 * np.pi * times)
    inductance = 10e-3 - 5e-3 * np.exp(-10.0 * distance)
    found = models.proximity(
        times,
        base_inductance=10e-3,
        inductance_change=5e-3,
        damping=10.0,
        capacitance=1e-6,
        mean_distance=0.02,
        distance_amplitude=0.01,
    )
    frequency = 1.0 / (2.0 * np.pi * np.sqrt(inductance * 1e-6))
    for value, plain in (
        (found.distance, distance),
        (found.inductance, inductance),
        (found.frequency, frequency),
    ):
        assert np.all(np.abs(value.mid - plain) <= 112 * np.spacing(plain))
        assert np.all(value.sup - value.inf <= 24 * np.spacing(plain))


def test_impedance_at_resonance_is_the_resistance() -> None:
    found = models.resonance(
        0.0,
        voltage=5.0,
        resistance=Interval(4.0, 6.0),
        capacitance=1e-6,
        source_frequency=1591.5494309189535,
        minimum_inductance=Interval(9e-3, 10e-3),
        maximum_inductance=Interval(10e-3, 11e-3),
        frequency=1.0,
    )
    assert found.reactance.inf < 0.0 < found.reactance.sup
    assert found.impedance.inf == 4.0
    assert found.current.sup == pytest.approx(1.25, rel=1e-14)
    assert found.phase.inf < 0.0 < found.phase.sup
    reactance = 2.0 * np.pi * 1591.5494309189535 * 10.5e-3 - 100.0
    assert found.impedance.sup == pytest.approx(np.hypot(6.0, reactance), rel=1e-12)
    assert found.phase.inf == pytest.approx(-np.arctan(reactance / 4.0), rel=1e-12)


def test_coil_spent_long_ago_holds_next_to_nothing() -> None:
    found = models.coil_energy(
        np.array([1.0, 1e30]), voltage=1.0, loss_resistance=1e4, inductance=1e-2
    )
    assert np.all(found.inf == 0.0)
    assert np.all((found.sup > 0.0) & (found.sup < 1e-318))


def test_base_inductance_stays_an_upper_bound_far_away() -> None:
    found = models.proximity_at(
        1e6, base_inductance=10e-3, inductance_change=5e-3, damping=10.0, capacitance=1e-6
    )
    assert found.inductance.inf < 10e-3 <= found.inductance.sup
    assert found.inductance.sup - found.inductance.inf <= 2 * np.spacing(10e-3)


def test_no_change_of_inductance_leaves_it_exact() -> None:
    found = models.proximity_at(
        0.02, base_inductance=10e-3, inductance_change=0.0, damping=0.0, capacitance=1e-6
    )
    assert found.inductance.inf == found.inductance.sup == 10e-3
