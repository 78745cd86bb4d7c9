"""The numbers that the paper states, and where it is wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eskin import models
from eskin.constants import PAPER_VACUUM_PERMITTIVITY
from eskin.interval import Interval

SENSOR: dict[str, Any] = {"minimum_capacitance": 10e-12, "maximum_capacitance": 100e-12}
SOURCE: dict[str, Any] = SENSOR | {"voltage": 5.0, "voltage_frequency": 50.0}
COIL: dict[str, Any] = {
    "voltage": Interval(0.9, 1.1),
    "loss_resistance": Interval(4.0, 6.0),
    "inductance": Interval(9e-3, 11e-3),
}


def test_capacitance_ranges_from_0_177_to_8_854_picofarad() -> None:
    found = models.capacitance(
        relative_permittivity=Interval(1.0, 5.0),
        area=Interval(1e-4, 2e-4),
        distance=Interval(1e-3, 5e-3),
        vacuum_permittivity=PAPER_VACUUM_PERMITTIVITY,
    )
    assert found.inf == pytest.approx(0.17708e-12, rel=1e-6, abs=0.0)
    assert found.sup == pytest.approx(8.854e-12, rel=1e-6, abs=0.0)


@pytest.mark.parametrize(
    ("distance", "picofarad"), [(3e-3, 0.2951), (4e-3, 0.2213), (5e-3, 0.1771)]
)
def test_capacitance_of_a_distance_is_that_of_fig_7(distance: float, picofarad: float) -> None:
    found = models.capacitance(relative_permittivity=1.0, area=1e-4, distance=distance)
    assert found.mid * 1e12 == pytest.approx(picofarad, abs=6e-5)


@pytest.mark.parametrize(("area", "picofarad"), [(0.6e-4, 0.531), (0.8e-4, 0.708)])
def test_capacitance_of_an_area_is_that_of_fig_8(area: float, picofarad: float) -> None:
    found = models.touch_of_area(area, distance=1e-3, voltage=0.5)
    assert found.capacitance.mid * 1e12 == pytest.approx(picofarad, abs=5e-4)


def test_energy_of_a_microfarad_at_half_a_volt_is_an_eighth_of_a_microjoule() -> None:
    plate = models.touch_of_area(1e-6 / 8.8541878188e-12 * 1e-3, distance=1e-3, voltage=0.5)
    assert plate.energy.mid == pytest.approx(0.125e-6)
    assert plate.energy.mid * 8400 == pytest.approx(1050e-6)


def test_current_is_a_thousand_times_the_text_with_the_papers_transconductance() -> None:
    times = np.arange(0.0, 0.5, 1e-3)
    printed = models.chain_current(times, transconductance=1e-3, **SENSOR)
    meant = models.chain_current(times, transconductance=1e-6, **SENSOR)
    assert printed.inf.min() == pytest.approx(100e-6)
    assert printed.sup.max() == pytest.approx(1e-3)
    assert meant.inf.min() == pytest.approx(100e-9, rel=1e-6, abs=0.0)
    assert meant.sup.max() == pytest.approx(1e-6)


def test_capacitance_of_eq_7_turns_negative() -> None:
    times = np.arange(0.0, 0.5, 1e-3)
    printed = models.alternating_capacitance_paper(times, **SENSOR)
    negative = times[printed.sup < 0.0]
    assert printed.inf.min() == pytest.approx(-80e-12, rel=1e-6, abs=0.0)
    assert (negative.min(), negative.max()) == pytest.approx((0.259, 0.491))
    corrected = models.alternating_capacitance(times, **SENSOR)
    assert corrected.inf.min() == pytest.approx(10e-12, rel=1e-6, abs=0.0)
    assert corrected.sup.max() == pytest.approx(100e-12, rel=1e-6, abs=0.0)


def test_current_of_fig_6_grows_past_100_nanoampere() -> None:
    times = np.arange(0.0, 0.125, 1e-5)
    current = models.alternating_current_paper(times, **SOURCE)
    capacitance = models.alternating_capacitance_paper(times, **SENSOR)
    assert current.sup[0] == pytest.approx(15.7e-9, rel=1e-3, abs=0.0)
    assert current.sup.max() == pytest.approx(157e-9, rel=2e-3, abs=0.0)
    amplitude = capacitance.mid * 5.0 * 2.0 * np.pi * 50.0
    assert capacitance.mid[np.argmax(amplitude > 100e-9)] == pytest.approx(
        63.7e-12, rel=1e-3, abs=0.0
    )


def test_what_eq_8_leaves_out_is_a_quarter_of_the_amplitude() -> None:
    times = np.arange(0.0, 0.125, 1e-5)
    printed = models.alternating_current_paper(times, **SOURCE)
    whole = models.alternating_current(times, swing=models.Swing.PAPER, **SOURCE)
    left_out = np.abs(whole.mid - printed.mid)
    amplitude = models.alternating_capacitance_paper(times, **SENSOR).mid * 5.0 * 100.0 * np.pi
    assert left_out.max() == pytest.approx(5.64e-9, rel=1e-2, abs=0.0)
    assert (left_out / amplitude).max() == pytest.approx(0.24, abs=0.005)


def test_inductance_changes_by_28_to_34_microhenry_over_three_quarters_of_a_millimetre() -> None:
    def at(distance: float) -> float:
        coil = models.proximity_at(
            distance,
            base_inductance=10e-3,
            inductance_change=5e-3,
            damping=10.0,
            capacitance=1e-6,
        )
        return float(coil.inductance.mid)

    assert at(10.75e-3) - at(10e-3) == pytest.approx(33.8e-6, rel=1e-2)
    assert at(30e-3) - at(29.25e-3) == pytest.approx(27.9e-6, rel=1e-2)


def test_reactance_of_the_coil_is_ten_times_the_papers_impedance() -> None:
    found = models.coil_current(
        voltage=1.0, resistance=1e-9, inductance=Interval(9e-3, 11e-3), frequency=1e3
    )
    assert 1.0 / found.magnitude.sup == pytest.approx(56.5, abs=0.1)
    assert 1.0 / found.magnitude.inf == pytest.approx(69.1, abs=0.1)


def test_interval_euler_runs_away_from_the_solution() -> None:
    euler = models.coil_energy_euler_paper(**COIL, step=1e-5, steps=200)
    solution = models.coil_energy(euler.time, **COIL)
    width = solution.sup - solution.inf
    assert euler.lower[0] == pytest.approx(solution.inf[0])
    assert euler.upper[0] == pytest.approx(solution.sup[0])
    assert (euler.upper[-1] - euler.lower[-1]) / width[-1] == pytest.approx(50.2, abs=0.1)
    assert np.all(euler.lower[19:] < 0.0)
    assert np.all(solution.inf > 0.0)


def test_corner_euler_lies_below_the_solution() -> None:
    euler = models.coil_energy_euler_paper(
        **COIL, step=1e-5, steps=200, rule=models.EulerRule.CORNER
    )
    solution = models.coil_energy(euler.time, **COIL)
    assert np.all(euler.upper[1:] < solution.sup[1:])
    assert np.all(euler.lower[1:] < solution.inf[1:])
    assert euler.upper[-1] / solution.sup[-1] == pytest.approx(0.9947, abs=1e-4)


def test_euler_of_an_array_of_coils_has_time_last() -> None:
    many = dict(COIL) | {"inductance": np.array([9e-3, 10e-3])}
    euler = models.coil_energy_euler_paper(**many, step=1e-5, steps=5)
    assert euler.time == pytest.approx(np.arange(6) * 1e-5)
    assert euler.lower.shape == euler.upper.shape == (2, 6)


def test_capacitance_has_no_inflection_over_the_distance() -> None:
    distance = np.linspace(1e-3, 5e-3, 401)
    found = models.capacitance(relative_permittivity=1.0, area=1e-4, distance=distance)
    assert np.all(np.diff(found.mid, 2) > 0.0)


def test_rule_that_is_none_is_named() -> None:
    with pytest.raises(ValueError, match="'edge' is not a valid EulerRule"):
        models.coil_energy_euler_paper(**COIL, step=1e-5, steps=2, rule="edge")  # type: ignore[arg-type]  # a wrong call on purpose
