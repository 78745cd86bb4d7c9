"""What swings as a sine: uncertain time and frequency, far times, weights that nearly vanish."""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb

from eskin import models
from eskin.interval import Interval
from tests.unit.eskin.models import truth
from tests.unit.eskin.models.cases import CASES, encloses, members

SWINGING = [
    "moving_plate",
    "touch",
    "harmonic_capacitance",
    "capacitive_chain",
    "chain_current",
    "alternating_capacitance_paper",
    "proximity",
    "resonance",
]


@pytest.mark.parametrize("name", SWINGING)
def test_uncertain_time_and_frequency_are_enclosed(name: str) -> None:
    case = CASES[name]
    generator = np.random.default_rng(30)
    box = case.boxes(generator, 300)
    start = generator.uniform(-2.0, 2.0, 300)
    box["time"] = Interval(start, start + generator.choice([0.0, 1e-3, 0.1, 1.0], 300))
    middle = generator.uniform(0.1, 3.0, 300)
    box["frequency"] = Interval(middle, middle * (1.0 + generator.choice([0.0, 1e-3, 0.1], 300)))
    found = case.evaluate(box)
    for _ in range(4):
        point = members(box, generator)
        for i in range(300):
            for result, exact in case.exact(point, i).items():
                assert encloses(found[result].inf[i], found[result].sup[i], exact), result


def test_uncertain_time_gives_the_range_of_the_swing() -> None:
    generator = np.random.default_rng(31)
    start = generator.uniform(-1.0, 1.0, 400)
    time = Interval(start, start + generator.uniform(0.0, 0.6, 400))
    found = models.harmonic_capacitance(time, minimum_capacitance=1.0, maximum_capacitance=3.0)
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    sampled = 2.0 + np.sin(4.0 * np.pi * (time.inf + share * (time.sup - time.inf)))
    assert np.all(found.inf <= sampled.min(axis=0) + 1e-14)
    assert np.all(found.sup >= sampled.max(axis=0) - 1e-14)
    assert np.all(found.inf >= sampled.min(axis=0) - 1e-5)
    assert np.all(found.sup <= sampled.max(axis=0) + 1e-5)


def test_a_whole_period_reaches_both_ends() -> None:
    found = models.harmonic_capacitance(
        Interval(0.1, 0.6), minimum_capacitance=1.0, maximum_capacitance=3.0
    )
    assert found.inf == pytest.approx(1.0, abs=1e-14)
    assert found.sup == pytest.approx(3.0, abs=1e-14)
    assert found.inf <= 1.0
    assert found.sup >= 3.0


def test_far_times_keep_their_phase() -> None:
    times = np.array([1e9 + 0.1, 1e15 + 0.5, 123456789012345.6, 1e40, -1e22])
    found = models.harmonic_capacitance(times, minimum_capacitance=1.0, maximum_capacitance=3.0)
    for i, time in enumerate(times):
        exact = truth.harmonic_capacitance({
            "minimum_capacitance": arb(1), "maximum_capacitance": arb(3),
            "frequency": arb(2), "time": arb(float(time)),
        })["value"]  # fmt: skip
        assert encloses(found.inf[i], found.sup[i], exact)
    assert np.all(found.sup - found.inf < 1e-14)


FAR_TIMES = [
    (Interval(0.0, 1e19), Interval(1.0)),
    (Interval(0.1, 1.001), Interval(1.0, 1e20)),
    (Interval(-1e40, 0.0), Interval(1.0)),
    (Interval(1e39, 1e40), Interval(1e39, 1e40)),
]


@pytest.mark.parametrize(("time", "frequency"), FAR_TIMES)
def test_both_extremes_are_reached_however_many_turns(time: Interval, frequency: Interval) -> None:
    """Beyond 2⁶³ half turns, too, which no integer of 64 bits counts."""
    ends = {"minimum_capacitance": 1e-12, "maximum_capacitance": 2e-12}
    raised = models.harmonic_capacitance(time, **ends, frequency=frequency)
    assert raised.inf <= 1e-12
    assert raised.sup >= 2e-12
    printed = models.alternating_capacitance_paper(time, **ends, frequency=frequency)
    assert printed.inf <= 0.0
    assert printed.sup >= 2e-12
    voltage = models.oscillation_paper(time, voltage=5.0, frequency=frequency)
    assert (voltage.inf, voltage.sup) == pytest.approx((-5.0, 5.0))
    assert voltage.inf <= -5.0
    assert voltage.sup >= 5.0


def test_a_single_far_time_stays_thin_beside_an_uncertain_one() -> None:
    far = np.array([1e17, 0.25])
    time = Interval(far, far + np.array([0.0, 0.5]))
    both = models.oscillation_paper(time, voltage=1.0, frequency=2.0)
    alone = models.oscillation_paper(1e17, voltage=1.0, frequency=2.0)
    assert both.inf[0] == alone.inf
    assert both.sup[0] == alone.sup


@pytest.mark.parametrize(("periods", "finest"), [(0.0, -16.0), (2.0**20, -9.5), (2.0**40, -3.5)])
def test_weights_that_nearly_vanish_stay_exact(periods: float, finest: float) -> None:
    generator = np.random.default_rng(32)
    # Beside the minimum at 3/8 s the great end counts next to nothing.
    aside = generator.choice([-1.0, 1.0], 500) * 10.0 ** generator.uniform(finest, -2, 500)
    times = 0.5 * periods + 0.375 + aside
    great = 10.0 ** generator.uniform(0.0, 25.0, 500)
    found = models.harmonic_capacitance(times, minimum_capacitance=1.0, maximum_capacitance=great)
    for i in range(500):
        exact = truth.harmonic_capacitance({
            "minimum_capacitance": arb(1), "maximum_capacitance": arb(float(great[i])),
            "frequency": arb(2), "time": arb(float(times[i])),
        })["value"]  # fmt: skip
        assert encloses(found.inf[i], found.sup[i], exact)
    assert np.all(found.sup - found.inf <= 32 * 2.0**-52 * found.sup)


@pytest.mark.parametrize("ends", [(1.0, 3.0), (3.0, 1.0), (2.0, 2.0)])
def test_voltage_of_the_chain_never_exceeds_one(ends: tuple[float, float]) -> None:
    low, high = ends
    times = np.linspace(-1.0, 1.0, 4001)
    found = models.capacitive_chain(
        times,
        minimum_capacitance=Interval(0.8 * low, 1.2 * low),
        maximum_capacitance=Interval(0.8 * high, 1.2 * high),
        resistance=Interval(1.0, 2.0),
        transconductance=1.0,
    )
    assert found.voltage.sup.max() == 1.0
    assert found.voltage.inf.min() > 0.0


def test_current_alone_is_that_of_the_chain() -> None:
    times = np.linspace(0.0, 1.0, 1001)
    low, high, gm = Interval(9e-12, 11e-12), Interval(90e-12, 110e-12), Interval(0.9e-3, 1.1e-3)
    chain = models.capacitive_chain(
        times,
        minimum_capacitance=low,
        maximum_capacitance=high,
        resistance=1e3,
        transconductance=gm,
    )
    alone = models.chain_current(
        times, minimum_capacitance=low, maximum_capacitance=high, transconductance=gm
    )
    assert np.array_equal(alone.inf, chain.current.inf)
    assert np.array_equal(alone.sup, chain.current.sup)


def test_a_swing_too_small_for_a_float_keeps_its_sign() -> None:
    """``f·t`` may be less than half of the least float, and negative."""
    got = models.oscillation_paper(-1e-310, voltage=1.0, frequency=Interval(0.0, 1e-36))
    assert got.inf < 0.0
    assert got.sup == 0.0
    assert models.oscillation_paper(1e-310, voltage=1.0, frequency=Interval(0.0, 1e-36)).sup > 0.0
