"""Wear and remaining time, against trajectories with 40 digits."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import IdentificationError
from eskin.identification import find_wear, mean_drift, remaining_time
from eskin.interval import Interval, Verdict

SEEDS = st.integers(0, 2**32 - 1)
SHEET = Interval(0.99, 1.01)


@pytest.mark.parametrize(
    ("parameter", "verdict"),
    [
        (Interval(1.02, 1.03), Verdict.CERTAIN),
        (Interval(0.97, 0.98), Verdict.CERTAIN),
        (Interval(1.0, 1.03), Verdict.POSSIBLE),
        (Interval(1.01, 1.03), Verdict.POSSIBLE),
        (Interval(0.9, 1.1), Verdict.POSSIBLE),
        (Interval(0.99, 1.01), Verdict.IMPOSSIBLE),
        (Interval(0.0, np.inf), Verdict.POSSIBLE),
        (Interval.empty(), Verdict.POSSIBLE),
    ],
)
def test_wear_is_certain_beyond_the_data_sheet(parameter: Interval, verdict: Verdict) -> None:
    found = find_wear(parameter, SHEET)
    assert bool(found.certain) == (verdict is Verdict.CERTAIN)
    assert bool(found.impossible) == (verdict is Verdict.IMPOSSIBLE)


def first_passage(
    start: float, limits: tuple[float, float], speeds: list[tuple[float, float]]
) -> Any:
    """When a value first lies outside, drifting at rates for some times each, then forever."""
    low, high = (mpmath.log(x) if x else -mpmath.inf for x in map(mpmath.mpf, limits))
    value, time = mpmath.log(start), mpmath.mpf(0)
    if not low <= value <= high:
        return time
    for speed, lasts in speeds:
        rate = mpmath.mpf(speed)
        way = (high - value) if rate > 0 else (low - value)
        needs = way / rate if rate else mpmath.inf
        if needs <= lasts:
            return time + needs
        value, time = value + rate * lasts, time + lasts
    return mpmath.inf


@given(SEEDS)
def test_remaining_time_encloses_each_trajectory(seed: int) -> None:
    draw = np.random.default_rng(seed)
    lo, hi = np.sort(draw.uniform(0.7, 1.4, 2)).tolist()
    limits = float(draw.choice([0.0, 0.8, 0.95])), float(draw.choice([1.05, 1.2, np.inf]))
    slow, fast = np.sort(draw.choice([-3e-3, -1e-3, 0.0, 1e-3, 2e-3], 2)).tolist()
    found = remaining_time(Interval(lo, hi), Interval(*limits), Interval(slow, fast))
    with mpmath.workdps(40):
        for start in [lo, hi, *draw.uniform(lo, hi, 3).tolist()]:
            pieces = [
                (
                    float(draw.choice([slow, fast, draw.uniform(slow, fast)])),
                    float(draw.uniform(1, 200)),
                )
                for _ in range(4)
            ]
            for speeds in (
                [(slow, mpmath.inf)],
                [(fast, mpmath.inf)],
                [*pieces, (fast, mpmath.inf)],
            ):
                passed = first_passage(start, limits, speeds)
                assert mpmath.mpf(float(found.inf)) <= passed
                assert passed <= mpmath.mpf(float(found.sup))


@given(SEEDS)
def test_bounds_of_the_remaining_time_are_reached(seed: int) -> None:
    draw = np.random.default_rng(seed)
    lo, hi = np.sort(draw.uniform(0.7, 1.4, 2)).tolist()
    limits = 0.8, 1.2
    slow, fast = np.sort(draw.choice([-3e-3, -1e-3, 1e-3, 2e-3], 2)).tolist()
    found = remaining_time(Interval(lo, hi), Interval(*limits), Interval(slow, fast))
    starts = [
        x for x in (lo, hi, *limits, *(np.nextafter(x, 1.0) for x in limits)) if lo <= x <= hi
    ]
    with mpmath.workdps(40):
        times = [
            first_passage(x, limits, [(rate, mpmath.inf)]) for x in starts for rate in (slow, fast)
        ]
        assert float(found.inf) == pytest.approx(float(min(times)), rel=1e-9, abs=1e-9)
        if slow * fast > 0.0:
            assert float(found.sup) == pytest.approx(float(max(times)), rel=1e-9, abs=1e-9)
        else:
            # A rate may be 0 forever, unless all starts lie outside.
            gone = hi < limits[0] or lo > limits[1]
            assert float(found.sup) == (0.0 if gone else math.inf)


def test_nothing_is_said_of_an_empty_enclosure() -> None:
    found = remaining_time(Interval.empty(), Interval(0.9, 1.1), Interval(1e-3, 2e-3))
    assert (float(found.inf), float(found.sup)) == (0.0, math.inf)


def test_arrays_are_broadcast() -> None:
    many = remaining_time(Interval([1.0, 1.2], [1.0, 1.3]), Interval(0.9, 1.1), Interval(-1.0, 1.0))
    assert many.inf[0] == pytest.approx(math.log(1.1))
    assert many[1].equal(Interval(0.0))


@given(SEEDS)
def test_mean_drift_encloses_what_happened(seed: int) -> None:
    draw = np.random.default_rng(seed)
    start, rate, time = draw.uniform(0.5, 2.0), draw.uniform(-1e-3, 1e-3), draw.uniform(1.0, 900.0)
    with mpmath.workdps(40):
        end = mpmath.mpf(start) * mpmath.exp(mpmath.mpf(rate) * mpmath.mpf(time))
        after = Interval.around(float(end), 1e-15)
        found = mean_drift(Interval(start), after, time)
        assert float(found.inf) <= rate <= float(found.sup)
        assert float(found.wid) < 1e-11 / time * 100


@pytest.mark.parametrize(
    "call",
    [
        lambda: remaining_time(Interval(1.0), Interval(-1.0, 1.0), 0.0),
        lambda: remaining_time(Interval(1.0), Interval(0.5, 2.0), Interval(0.0, np.inf)),
        lambda: mean_drift(Interval(1.0), Interval(1.0), 0.0),
        lambda: mean_drift(Interval.empty(), Interval(1.0), 1.0),
    ],
)
def test_what_cannot_be_used_is_refused(call: Any) -> None:
    with pytest.raises(IdentificationError):
        call()
