"""Noise on a touch: drawn as often as asked, enclosed as often as promised."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from eskin import models
from eskin.errors import IntervalError
from eskin.noise import GaussianNoise, touch_with_noise, touch_within

if TYPE_CHECKING:
    from eskin.interval import Interval

TIMES = np.linspace(0.0, 5.0, 20_001)
PLATE = {"distance": 1e-3, "voltage": 0.5}
NOISE = GaussianNoise(area=2e-6, capacitance=5e-15, energy=1e-15)


def _area() -> Interval:
    return models.touch(TIMES, minimum_area=1e-5, maximum_area=1e-4, **PLATE).area


def test_readings_scatter_about_the_truth_as_they_should() -> None:
    true = models.touch_of_area(_area(), **PLATE)
    got = touch_with_noise(true.area.mid, noise=NOISE, generator=np.random.default_rng(1), **PLATE)
    per_area = 8.8541878188e-12 / 1e-3
    of_capacitance = math.hypot(5e-15, 2e-6 * per_area)
    of_energy = math.hypot(1e-15, 0.125 * of_capacitance)
    for reading, truth, sigma in (
        (got.area, true.area.mid, 2e-6),
        (got.capacitance, true.capacitance.mid, of_capacitance),
        (got.energy, true.energy.mid, of_energy),
    ):
        error = reading - truth
        assert error.std() == pytest.approx(sigma, rel=0.03, abs=0.0)
        assert abs(error.mean()) < 4.0 * sigma / math.sqrt(error.size)


def test_same_seed_gives_same_readings() -> None:
    first, second, other = (
        touch_with_noise(_area().mid, noise=NOISE, generator=np.random.default_rng(seed), **PLATE)
        for seed in (1, 1, 2)
    )
    assert np.array_equal(first.energy, second.energy)
    assert not np.array_equal(first.energy, other.energy)


def test_no_noise_leaves_the_formula() -> None:
    got = touch_with_noise(
        np.array([1e-4]), noise=GaussianNoise(), generator=np.random.default_rng(1), **PLATE
    )
    assert got.capacitance == pytest.approx(8.8541878188e-13, rel=1e-8, abs=0.0)
    assert got.energy == pytest.approx(0.125 * 8.8541878188e-13, rel=1e-8, abs=0.0)


def test_area_never_turns_negative() -> None:
    got = touch_with_noise(np.zeros(1000), noise=NOISE, generator=np.random.default_rng(1), **PLATE)
    assert got.area.min() == 0.0
    assert got.area.max() > 0.0


@pytest.mark.parametrize("noise", [NOISE, GaussianNoise(area=3e-6), GaussianNoise(energy=1e-15)])
@pytest.mark.parametrize("deviations", [1.0, 2.0, 3.0])
def test_enclosure_holds_as_many_readings_as_it_says(
    noise: GaussianNoise, deviations: float
) -> None:
    within, coverage = touch_within(_area(), noise=noise, deviations=deviations, **PLATE)
    got = touch_with_noise(_area().mid, noise=noise, generator=np.random.default_rng(3), **PLATE)
    inside = (
        within.area.contains(got.area)
        & within.capacitance.contains(got.capacitance)
        & within.energy.contains(got.energy)
    )
    spread = math.sqrt(0.25 / inside.size)
    assert inside.mean() >= coverage - 4.0 * spread
    if noise is not NOISE:  # a single source leaves out just as much as it says
        assert inside.mean() <= coverage + 4.0 * spread


def test_noise_of_zero_width_is_the_model_itself() -> None:
    within, coverage = touch_within(_area(), noise=GaussianNoise(), deviations=3.0, **PLATE)
    true = models.touch_of_area(_area(), **PLATE)
    assert coverage == 1.0
    assert np.array_equal(within.energy.sup, true.energy.sup)
    assert np.array_equal(within.capacitance.inf, true.capacitance.inf)


def test_sources_of_noise_never_add_up_to_certainty() -> None:
    _, coverage = touch_within(1e-4, noise=NOISE, deviations=9.0, **PLATE)
    assert coverage < 1.0


@pytest.mark.parametrize("name", ["area", "capacitance", "energy"])
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf, "much", np.ones(2)])
def test_noise_that_is_no_deviation_is_refused(name: str, value: Any) -> None:
    with pytest.raises(IntervalError, match=f"standard deviation of {name}"):
        GaussianNoise(**{name: value})


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"area": -1e-4}, "area must be 0 or"),
        ({"area": np.array([1e-4, math.nan])}, r"area must be 0 or .* nan\] at index"),
        ({"distance": 0.0}, "distance must be > 0"),
        ({"distance": -1e-3}, "distance must be > 0"),
        ({"voltage": math.inf}, "voltage"),
        ({"area": np.ones(3), "distance": np.ones(2)}, "shapes do not fit"),
        ({"area": "wide"}, "area: "),
    ],
)
def test_touch_that_cannot_be_is_refused(changed: dict[str, Any], said: str) -> None:
    given: dict[str, Any] = {"area": 1e-4, **PLATE, **changed}
    area = given.pop("area")
    with pytest.raises(IntervalError, match=said):
        touch_with_noise(area, noise=NOISE, generator=np.random.default_rng(1), **given)
    with pytest.raises(IntervalError, match=said):
        touch_within(area, noise=NOISE, deviations=6.0, **given)


@pytest.mark.parametrize("deviations", [-1.0, math.nan, math.inf])
def test_number_of_deviations_that_is_none_is_refused(deviations: float) -> None:
    with pytest.raises(IntervalError, match="deviations must be"):
        touch_within(1e-4, noise=NOISE, deviations=deviations, **PLATE)
