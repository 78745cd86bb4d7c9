"""What a model refuses, and how it says so."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from eskin import models
from eskin.errors import IntervalError
from eskin.interval import Interval
from tests.unit.eskin.models.cases import CASES, FAR

EMPTY = Interval._trusted(np.array(math.inf), np.array(-math.inf))
PAIRS = [(name, key) for name, case in CASES.items() for key in case.ranges]
PROXIMITY = {
    "base_inductance": 10e-3,
    "inductance_change": 5e-3,
    "damping": 10.0,
    "capacitance": 1e-6,
    "mean_distance": 0.02,
    "distance_amplitude": 0.01,
}


def _valid(name: str) -> dict[str, Any]:
    return {
        key: 0.5 if (low, high) == FAR else math.sqrt(low * high)
        for key, (low, high) in CASES[name].ranges.items()
    }


@pytest.mark.parametrize(("name", "key"), PAIRS)
@pytest.mark.parametrize(
    ("value", "said"),
    [
        (math.nan, "nan|NaN"),
        (math.inf, "inf"),
        (-math.inf, "-inf"),
        (1e41, "1e\\+41"),
        (Interval(1.0, math.inf), "inf|one number"),
        (Interval(-math.inf, math.inf), "-inf|one number"),
        (EMPTY, "empty|one number"),
        (np.array([1.0 + 2.0j]), "complex"),
        ("much", "much|dtype|real"),
    ],
)
def test_what_is_no_finite_number_is_refused(name: str, key: str, value: Any, said: str) -> None:
    with pytest.raises(IntervalError, match=f"(?s){key}.*({said})"):
        CASES[name].call(**_valid(name) | {key: value})


@pytest.mark.parametrize(("name", "key"), [pair for pair in PAIRS if pair[1] != "time"])
def test_a_negative_parameter_is_refused_with_its_place(name: str, key: str) -> None:
    values = np.full(3, _valid(name)[key])
    values[1] = -values[1]
    with pytest.raises(IntervalError, match=rf"{key} must be .*, is -.*at index \(1,\)"):
        CASES[name].call(**_valid(name) | {key: values})


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("capacitance", "distance"),
        ("capacitance", "area"),
        ("lc_frequency", "inductance"),
        ("coil_current", "resistance"),
        ("coil_energy", "loss_resistance"),
        ("harmonic_capacitance", "minimum_capacitance"),
        ("proximity", "capacitance"),
        ("resonance", "source_frequency"),
        ("energy_flow", "switch_resistance"),
    ],
)
@pytest.mark.parametrize("value", [0.0, Interval(0.0, 1e-3), 5e-324])
def test_zero_is_refused_where_it_divides(name: str, key: str, value: Any) -> None:
    with pytest.raises(IntervalError, match=f"{key} must be > 0"):
        CASES[name].call(**_valid(name) | {key: value})


@pytest.mark.parametrize(
    ("name", "key", "results"),
    [
        ("coil_energy", "voltage", ["value"]),
        ("coil_current", "voltage", ["magnitude"]),
        ("touch", "voltage", ["energy"]),
        ("alternating_current", "voltage", ["value"]),
        ("energy_flow", "voltage", ["supplied", "stored", "loss", "switch_loss"]),
        ("energy_flow", "time", ["supplied", "magnetic", "electric", "coil_loss"]),
    ],
)
def test_zero_is_right_where_it_means_nothing_flows(
    name: str, key: str, results: list[str]
) -> None:
    found = CASES[name].evaluate(_valid(name) | {key: 0.0})
    for result in results:
        assert found[result].inf == 0.0
        assert 0.0 <= found[result].sup <= 1e-319


@pytest.mark.parametrize("key", ["voltage_frequency", "frequency", "time"])
def test_an_interval_is_refused_where_one_number_is_needed(key: str) -> None:
    with pytest.raises(IntervalError, match=rf"{key} must be one number each, is \[0.5, 0.75\]"):
        models.alternating_current(**_valid("alternating_current") | {key: Interval(0.5, 0.75)})


def test_a_change_of_inductance_that_leaves_none_is_refused() -> None:
    with pytest.raises(
        IntervalError, match=r"inductance_change must be less than base_inductance, is 0\.01"
    ):
        models.proximity(0.0, **PROXIMITY | {"inductance_change": 10e-3})


def test_a_swing_into_the_coil_is_refused() -> None:
    with pytest.raises(
        IntervalError, match=r"distance_amplitude must be at most mean_distance, is \[0.01, 0.03\]"
    ):
        models.proximity(0.0, **PROXIMITY | {"distance_amplitude": Interval(0.01, 0.03)})


@pytest.mark.parametrize(("step", "steps"), [(0.0, 3), (-1.0, 3), (math.nan, 3), (1e-5, -1)])
def test_euler_steps_that_lead_nowhere_are_refused(step: float, steps: int) -> None:
    with pytest.raises(IntervalError, match="step"):
        models.coil_energy_euler_paper(
            voltage=1.0, loss_resistance=5.0, inductance=1e-2, step=step, steps=steps
        )
