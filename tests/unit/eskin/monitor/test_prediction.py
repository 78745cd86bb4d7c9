"""Predictions in formulas: what is outside of them, offline and online."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import MonitorError
from eskin.interval import Interval
from eskin.monitor import (
    Channel,
    Deviation,
    Monitor,
    Prediction,
    PredictionParameter,
    Signal,
    Verdicts,
    evaluate,
    is_exact,
    parse,
)
from eskin.monitor.predicted_quantities import MODELS
from eskin.monitor.prediction import deviation
from tests.support.examples import examples

MS = 10**6
START = 1_800_000_000 * 10**9
SWING = (
    PredictionParameter("minimum_capacitance", Fraction(9), Fraction(11), "pF"),
    PredictionParameter("maximum_capacitance", Fraction(95), Fraction(105), "pF"),
    PredictionParameter("frequency", Fraction(2), Fraction(2), "Hz"),
)
MODEL = "alternating_capacitance"


def swinging(origin: int = START) -> Prediction:
    return Prediction(MODEL, SWING, origin)


def exactly(instant: int, origin: int = START) -> Interval:
    found: Interval = MODELS[MODEL].function(
        Interval(float(Fraction(instant - origin, 10**9))),
        minimum_capacitance=Interval(9e-12, 11e-12),
        maximum_capacitance=Interval(95e-12, 105e-12),
        frequency=Interval(2.0),
    )
    return found


@settings(max_examples=examples(30), deadline=None)
@given(st.integers(-(10**18), 10**18), st.integers(0, 10**10), st.floats(0.0, 1.0))
def test_a_range_of_time_encloses_all_that_is_predicted_in_it(
    begin: int, span: int, part: float
) -> None:
    first, last = np.array([START + begin]), np.array([START + begin + span])
    lo, hi = swinging().between(first, last, "F")
    inner = exactly(min(int(first[0]) + int(span * part), int(last[0])))
    # A thin instant's own rounding is not part of what must be enclosed.
    assert lo[0] <= inner.sup
    assert hi[0] >= inner.inf


@pytest.mark.parametrize("origin", [-(2**63) + 10, -5, 0, START, 2**63 - 1])
def test_model_times_enclose_the_exact_ones_however_far(origin: int) -> None:
    ends = (-(2**63) + 1, -(2**62), -1, 0, 1, START, START + 1, 2**62, 2**63 - 1)
    instants = np.array(ends)
    lo, hi = swinging(origin).between(instants, instants, "F")
    assert np.all(lo <= hi)
    whole = swinging(START).between(np.array([START]), np.array([START + 10**9]), "F")
    assert np.all((lo >= whole[0]) & (hi <= whole[1]))


BAND = st.tuples(st.integers(-4, 4), st.integers(0, 4)).map(lambda p: (p[0], p[0] + p[1]))


@settings(max_examples=examples(200))
@given(st.lists(BAND, min_size=1, max_size=8), BAND)
def test_a_deviation_from_a_constant_is_that_of_each_value_in_the_interval(
    samples: list[tuple[int, int]], band: tuple[int, int]
) -> None:
    p, q = band
    prediction = Prediction("constant", (PredictionParameter("value", Fraction(p), Fraction(q)),))
    instants = 10 * MS * np.arange(len(samples))
    lo, hi = np.array(samples, np.float64).T
    found = deviation(Signal(instants, instants, lo, hi, 10 * MS), prediction)
    for k, (low, high) in enumerate(samples):
        # The deviation is convex, and linear between whole numbers: so its ends are at them.
        exact = [max(p - x, x - q) for x in range(low, high + 1)]
        inside = min(max(low, (p + q) / 2), high)
        least = min(*exact, max(p - inside, inside - q))
        assert found.lo[k] <= least
        assert max(exact) <= found.hi[k] <= np.nextafter(max(exact), np.inf)
        assert bool(found.lo[k] > 0) is (low > q or high < p)
        assert bool(found.hi[k] > 0) is not (p <= low and high <= q)


def sampled(moved: dict[int, float], n: int = 50) -> Signal:
    instants = START + 10 * MS * np.arange(n)
    bands = [exactly(int(t)) for t in instants]
    middle = np.array([float(band.mid) for band in bands])
    for k, by in moved.items():
        middle[k] += by
    return Signal(instants, instants, middle - 1e-15, middle + 1e-15, 10 * MS, unit="F")


def test_an_anomaly_is_certain_offline_and_online() -> None:
    signal = sampled({20: 60e-12, 21: 60e-12})
    formula = Deviation(source="p", prediction=swinging()) > 0
    offline = evaluate(formula, {"p": signal})
    monitor = Monitor(formula, {"p": "F"})
    monitor.extend("p", signal.earliest, signal.latest, signal.lo, signal.hi, 10 * MS)
    taken = monitor.take()
    certain = [piece for piece in taken if piece.verdict == 2]
    assert [(piece.start, piece.end) for piece in certain] == [(START + 200 * MS, START + 220 * MS)]
    for piece in taken[1:-1]:
        assert piece.start is not None
        assert offline.at(piece.start) is piece.verdict


def test_a_formula_may_read_a_channel_and_its_deviation() -> None:
    formula = (Deviation(source="p", prediction=swinging()) > 0) & (Channel("p") > 0)
    assert formula.sources == {"p"}
    assert len(formula.channels) == 2
    monitor = Monitor(formula, {"p": "F"})
    monitor.push("p", START, START, 5e-10, 6e-10, period=10 * MS)
    monitor.gap("p", START + 30 * MS)
    monitor.push("p", START + 40 * MS, START + 40 * MS, 5e-10, 6e-10, period=10 * MS)
    view: Verdicts = monitor.verdicts
    assert [view.at(START + at * MS).name for at in (0, 5, 20, 40)] == [
        *("CERTAIN", "CERTAIN", "POSSIBLE", "CERTAIN")
    ]
    assert not is_exact(formula, {"p": "F"})


@pytest.mark.parametrize("wrong", [(START, 5e-10, 6e-10), (START + 20 * MS, 6e-10, 5e-10)])
def test_a_channel_and_its_deviation_stay_alike_after_a_wrong_sample(
    wrong: tuple[int, float, float],
) -> None:
    formula = (Deviation(source="p", prediction=swinging()) > 0) & (Channel("p") > 0)
    monitor = Monitor(formula, {"p": "F"})
    at, lo, hi = wrong
    instants = [START + 10 * MS, at]
    monitor.push("p", START, START, 5e-10, 6e-10, period=10 * MS)
    with pytest.raises(MonitorError):
        monitor.extend("p", instants, instants, [5e-10, lo], [6e-10, hi], 10 * MS)
    monitor.push("p", START + 30 * MS, START + 30 * MS, 5e-10, 6e-10, period=10 * MS)
    assert len(monitor) in {4, 6}  # as many of both
    assert monitor.verdicts.at(START + 30 * MS).name == "CERTAIN"


_PLATE = (
    "outside(p, moving_plate.capacitance(area = 1 cm2, minimum_distance = [0.9, 1.1 mm], "
    'maximum_distance = 5 mm, frequency = 1 Hz), "2026-01-31T12:00:00Z") > 1 pF'
)


@pytest.mark.parametrize(
    "text",
    [
        _PLATE,
        'outside("n1/t01.area", constant(value = [-1, 2])) > 0',
        "outside(p, constant(value = 3), -5) > 0 and p < 3",
    ],
)
def test_its_text_is_read_back(text: str) -> None:
    formula = parse(text)
    assert parse(str(formula)) == formula


@pytest.mark.parametrize(
    "text",
    [
        "outside(p, weather(x = 1)) > 0",
        "outside(p, constant()) > 0",
        "outside(p, constant(value = 1, value = 2)) > 0",
        "outside(p, constant(value = 1, colour = 2)) > 0",
        "outside(p, constant(value = [3, 2])) > 0",
        "outside(p, constant(value = [3 pF, 4 F])) > 0",
        "outside(p, constant(value = 4 Hz)) > 0",
        "outside(p, constant(value = x)) > 0",
        "outside(p, constant(value = 1), 5 s) > 0",
        'outside(p, constant(value = 1), "noon") > 0',
        "outside(p, touch.area(minimum_area=1, maximum_area=2, distance=1, voltage=1)) > 0",
        "outside(q, constant(value = 1)) > 0",
        "outside(p + p, constant(value = 1)) > 0",
        "outside(3, constant(value = 1)) > 0",
        "outside(p, constant(value = 1)) > 0 Hz",
    ],
)
def test_what_does_not_fit_is_refused_with_its_place(text: str) -> None:
    with pytest.raises(MonitorError) as caught:
        evaluate(parse(text), {"p": sampled({})})
    assert caught.value.column is not None


def test_a_parameter_outside_of_the_domain_is_refused() -> None:
    wrong = (*SWING[:1], *SWING[1:2], PredictionParameter("frequency", Fraction(-1), Fraction(1)))
    formula = Deviation(source="p", prediction=Prediction(MODEL, wrong)) > 0
    with pytest.raises(MonitorError):
        evaluate(formula, {"p": sampled({})})
