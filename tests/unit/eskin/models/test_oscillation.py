"""The voltage of Fig. 9: as the paper draws it, and with the phase that an oscillator has."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from flint import arb

from eskin import models
from eskin.errors import IntervalError
from eskin.interval import Interval
from tests.unit.eskin.models.cases import encloses

COIL: dict[str, Any] = {
    "base_inductance": 10e-3,
    "inductance_change": 5e-3,
    "damping": 10.0,
    "capacitance": 1e-6,
    "mean_distance": 0.02,
    "distance_amplitude": 0.01,
}


def test_members_of_frequency_and_voltage_lie_inside() -> None:
    generator = np.random.default_rng(60)
    times = generator.uniform(0.0, 0.1, 500)
    slow = generator.uniform(10.0, 2000.0, 500)
    fast = slow * (1.0 + generator.choice([0.0, 1e-6, 1e-3], 500))
    found = models.oscillation_paper(
        times, voltage=Interval(4.5, 5.5), frequency=Interval(slow, fast)
    )
    for share in (0.0, 0.5, 1.0):
        frequency = np.clip(slow + share * (fast - slow), slow, fast)
        for i in range(500):
            for volts in (4.5, 5.0, 5.5):
                exact = arb(volts) * (2 * arb(float(frequency[i])) * arb(float(times[i]))).sin_pi()
                assert encloses(found.inf[i], found.sup[i], exact)


def test_steady_frequency_gives_one_sine_both_ways() -> None:
    times = np.linspace(0.0, 0.01, 1001)
    steady = models.oscillation(times, voltage=5.0, frequency=Interval(np.full(1000, 2000.0)))
    paper = models.oscillation_paper(times, voltage=5.0, frequency=2000.0)
    assert np.all((steady.inf <= paper.sup) & (paper.inf <= steady.sup))
    assert np.all(steady.sup - steady.inf < 1e-9)


def test_phase_of_a_moving_object_is_the_integral() -> None:
    times = np.linspace(0.0, 0.25, 50_001)
    steps = models.proximity(Interval(times[:-1], times[1:]), **COIL).frequency
    found = models.oscillation(times, voltage=5.0, frequency=steps)
    # Gauss-Legendre over each step stands in for the integral.
    nodes, weights = np.polynomial.legendre.leggauss(4)
    half = 0.5 * (times[1] - times[0])
    inner = (times[:-1] + half)[:, None] + half * nodes
    frequency = models.proximity(inner, **COIL).frequency.mid
    phase = np.concatenate([[0.0], np.cumsum(half * (frequency @ weights))])
    exact = 5.0 * np.sin(2.0 * np.pi * phase)
    assert np.all(found.inf <= exact + 1e-7)
    assert np.all(exact - 1e-7 <= found.sup)
    assert (found.sup - found.inf).max() < 0.05
    paper = models.oscillation_paper(
        times, voltage=5.0, frequency=models.proximity(times, **COIL).frequency
    )
    assert np.abs(paper.mid - found.mid).max() > 5.0


def test_rows_of_frequencies_give_rows_of_voltages() -> None:
    times = np.array([0.0, 0.25, 0.5])
    found = models.oscillation(
        times, voltage=[[1.0], [2.0]], frequency=Interval([[1.0, 1.0], [1.0, 2.0]])
    )
    assert found.mid == pytest.approx(np.array([[0.0, 1.0, 0.0], [0.0, 2.0, -2.0]]), abs=1e-9)


@pytest.mark.parametrize(
    ("time", "frequency", "said"),
    [
        ([0.0, 1.0, 1.0], [1.0, 1.0], "rise"),
        ([[0.0, 1.0]], [1.0], "one axis"),
        ([0.0, 1.0], [1.0, 2.0], "each of the 1 steps"),
        ([0.0, 1.0], 1.0, "each of the 1 steps"),
        ([0.0, 1.0], [-1.0], "frequency must be"),
    ],
)
def test_steps_that_do_not_fit_are_refused(time: Any, frequency: Any, said: str) -> None:
    with pytest.raises(IntervalError, match=said):
        models.oscillation(time, voltage=1.0, frequency=Interval(frequency))


@pytest.mark.parametrize("time", [0.0, [0.0], [0.0, 0.0], ["a", "b"], [0.0, np.nan]])
def test_times_that_are_no_rising_instants_are_refused(time: Any) -> None:
    with pytest.raises(IntervalError, match="time"):
        models.oscillation(time, voltage=5.0, frequency=Interval([1.0]))
