"""A threshold separates certain, possible and missed touches, and errs as normal noise does."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from eskin.errors import IntervalError
from eskin.interval import Interval, Verdict
from eskin.noise import detect, error_rates

DRAWS = 100_000
NOISE = np.array([0.0, 0.5, 1.0, 3.0])
THRESHOLD = np.array([-1.0, 0.0, 2.0, 4.0, 5.0])


def test_detection_is_certain_possible_or_missed() -> None:
    readings = Interval([1.0, 1.0, 2.0, 0.0, 0.0], [3.0, 2.0, 3.0, 2.0, 1.9])
    assert detect(readings, 2.0).tolist() == [
        Verdict.POSSIBLE,
        Verdict.POSSIBLE,
        Verdict.CERTAIN,
        Verdict.POSSIBLE,
        Verdict.IMPOSSIBLE,
    ]


def test_thresholds_broadcast_against_readings() -> None:
    found = detect(Interval([0.0, 1.0], [2.0, 1.5]), np.array([[0.0], [1.0], [3.0]]))
    assert found.tolist() == [[2, 2], [1, 2], [0, 0]]


def test_no_member_contradicts_the_verdict() -> None:
    generator = np.random.default_rng(1)
    inf = generator.normal(size=500)
    readings = Interval(inf, inf + generator.uniform(0.0, 1.0, 500))
    verdict = detect(readings, 0.1)
    for share in (0.0, 0.3, 1.0):
        reached = inf + share * (readings.sup - inf) >= 0.1
        assert np.all(reached[verdict == Verdict.CERTAIN])
        assert not np.any(reached[verdict == Verdict.IMPOSSIBLE])
    assert {int(v) for v in np.unique(verdict)} == {0, 1, 2}


def test_plain_readings_are_thin() -> None:
    assert detect([1.0, 2.0], 1.5).tolist() == [Verdict.IMPOSSIBLE, Verdict.CERTAIN]


@pytest.mark.parametrize(
    ("readings", "threshold", "said"),
    [
        (Interval(0.0, 1.0), "high", "threshold: could not convert"),
        (Interval([0.0, 1.0], [1.0, 2.0]), math.nan, "NaN"),
        (Interval._trusted(np.array(math.inf), np.array(-math.inf)), 1.0, "empty"),
        (Interval([0.0, 1.0], [1.0, 2.0]), np.zeros(3), "do not fit"),
    ],
)
def test_what_no_threshold_can_judge_is_refused(
    readings: Interval, threshold: Any, said: str
) -> None:
    with pytest.raises(IntervalError, match=said):
        detect(readings, threshold)


def _rates(**changed: Any) -> Any:
    given: dict[str, Any] = {
        "untouched": 0.0,
        "touched": 4.0,
        "noise": NOISE,
        "threshold": THRESHOLD,
    }
    return error_rates(**given | changed)


def exact_rates(at_rest: float, at_touch: float, sigma: float, limit: float) -> tuple[Any, Any]:
    """Probabilities of a false positive and a false negative, in the context's precision."""
    if sigma == 0.0:
        return mpmath.mpf(at_rest >= limit), mpmath.mpf(at_touch < limit)
    to_rest, to_touch = (mpmath.mpf(limit) - mpmath.mpf(x) for x in (at_rest, at_touch))
    scale = mpmath.mpf(sigma) * mpmath.sqrt(2)
    # Beyond 1e3 the tail is less than 1e-400000, and more than mpmath finds.
    feigned, hidden = (max(-1000, min(1000, x / scale)) for x in (to_rest, -to_touch))
    return mpmath.erfc(feigned) / 2, mpmath.erfc(hidden) / 2


SIZES = st.floats(-1e3, 1e3)


@given(SIZES, SIZES, st.floats(0.0, 1e3), SIZES)
@example(0.0, 1e-5, 2e-6, 4e-6)
@example(0.1, 0.3, 1e-3, 0.3)
@example(0.3, 0.3, 0.0, 0.3)
def test_rates_hold_the_closed_form(
    at_rest: float, at_touch: float, sigma: float, limit: float
) -> None:
    found = error_rates(untouched=at_rest, touched=at_touch, noise=[sigma], threshold=[limit])
    with mpmath.workprec(400):
        for rate, exact in zip(
            (found.false_positive, found.false_negative),
            exact_rates(at_rest, at_touch, sigma, limit),
            strict=True,
        ):
            inf, sup = (mpmath.mpf(float(side[0, 0])) for side in (rate.inf, rate.sup))
            assert inf <= exact <= sup
            assert sup - inf <= exact * mpmath.mpf(1e-9) + mpmath.mpf(1e-318)


def test_without_noise_the_threshold_alone_decides() -> None:
    found = _rates()
    for side in (found.false_positive.inf, found.false_positive.sup):
        assert side[0].tolist() == [1.0, 1.0, 0.0, 0.0, 0.0]
    for side in (found.false_negative.inf, found.false_negative.sup):
        assert side[0].tolist() == [0.0, 0.0, 0.0, 0.0, 1.0]


def test_rates_are_those_of_counted_readings() -> None:
    found = _rates()
    generator = np.random.default_rng(7)
    noise = generator.standard_normal(DRAWS)
    for i, sigma in enumerate(NOISE):
        for j, limit in enumerate(THRESHOLD):
            for rate, counted in (
                (found.false_positive, np.mean(0.0 + sigma * noise >= limit)),
                (found.false_negative, np.mean(4.0 + sigma * noise < limit)),
            ):
                expected = rate.mid[i, j]
                spread = math.sqrt(expected * (1.0 - expected) / DRAWS)
                assert abs(counted - expected) <= 4.5 * spread + 1.0 / DRAWS


def test_higher_threshold_feigns_less_and_hides_more() -> None:
    found = _rates(threshold=np.linspace(-5.0, 9.0, 50))
    assert np.all(np.diff(found.false_positive.inf, axis=1) <= 0.0)
    assert np.all(np.diff(found.false_negative.inf, axis=1) >= 0.0)


def test_uncertain_states_give_rates_that_hold_every_member() -> None:
    wide = _rates(untouched=Interval(-0.5, 0.5), touched=Interval(3.5, 4.5))
    for shift in (-0.5, 0.1, 0.5):
        one = _rates(untouched=shift, touched=4.0 + shift)
        assert np.all(one.false_positive.subset(wide.false_positive))
        assert np.all(one.false_negative.subset(wide.false_negative))
    assert np.any(wide.false_positive.inf < wide.false_positive.sup)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"noise": [-1.0]}, "noise must be >= 0"),
        ({"noise": [math.nan]}, "noise must be one axis"),
        ({"threshold": [[1.0]]}, "threshold must be one axis"),
        ({"threshold": [math.inf]}, "threshold must be one axis"),
        ({"noise": "much"}, "noise: could not convert"),
        ({"touched": None}, "touched: "),
        ({"touched": [1.0, 2.0]}, "touched must be one"),
        ({"untouched": Interval(-math.inf, 0.0)}, "untouched must be one"),
    ],
)
def test_settings_that_make_no_curve_are_refused(changed: dict[str, Any], said: str) -> None:
    with pytest.raises(IntervalError, match=said):
        _rates(**changed)
