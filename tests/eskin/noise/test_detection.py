"""A threshold tells certain, possible and missed touches apart, and errs as normal noise does."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Any

import numpy as np
import pytest

from eskin.errors import IntervalError
from eskin.interval import Interval
from eskin.noise import Detection, detect, error_rates

DRAWS = 100_000
NORMAL = NormalDist()
NOISE = np.array([0.0, 0.5, 1.0, 3.0])
THRESHOLD = np.array([-1.0, 0.0, 2.0, 4.0, 5.0])


def test_detection_is_certain_possible_or_missed() -> None:
    readings = Interval([1.0, 1.0, 2.0, 0.0, 0.0], [3.0, 2.0, 3.0, 2.0, 1.9])
    assert detect(readings, 2.0).tolist() == [
        Detection.POSSIBLE,
        Detection.POSSIBLE,
        Detection.CERTAIN,
        Detection.POSSIBLE,
        Detection.MISSED,
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
        assert np.all(reached[verdict == Detection.CERTAIN])
        assert not np.any(reached[verdict == Detection.MISSED])
    assert {int(v) for v in np.unique(verdict)} == {0, 1, 2}


def test_plain_readings_are_thin() -> None:
    assert detect([1.0, 2.0], 1.5).tolist() == [Detection.MISSED, Detection.CERTAIN]


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
        "draws": DRAWS,
        "generator": np.random.default_rng(7),
    }
    return error_rates(**given | changed)


def test_rates_follow_the_normal_distribution() -> None:
    found = _rates()
    assert found.false_positive.inf.shape == (NOISE.size, THRESHOLD.size)
    for i, sigma in enumerate(NOISE[1:], start=1):
        for j, limit in enumerate(THRESHOLD):
            feigned = NORMAL.cdf((0.0 - limit) / sigma)
            hidden = NORMAL.cdf((limit - 4.0) / sigma)
            for rate, expected in (
                (found.false_positive, feigned),
                (found.false_negative, hidden),
            ):
                assert rate.inf[i, j] == rate.sup[i, j]
                spread = math.sqrt(expected * (1.0 - expected) / DRAWS)
                assert abs(rate.inf[i, j] - expected) <= 4.5 * spread + 1.0 / DRAWS


def test_without_noise_the_threshold_alone_decides() -> None:
    found = _rates()
    assert found.false_positive.inf[0].tolist() == [1.0, 1.0, 0.0, 0.0, 0.0]
    assert found.false_negative.inf[0].tolist() == [0.0, 0.0, 0.0, 0.0, 1.0]


def test_rates_are_those_of_counted_readings() -> None:
    found = _rates(draws=1000)
    generator = np.random.default_rng(7)
    rest, hand = generator.standard_normal(1000), generator.standard_normal(1000)
    for i, sigma in enumerate(NOISE):
        for j, limit in enumerate(THRESHOLD):
            feigned = np.mean(0.0 + sigma * rest >= limit)
            hidden = np.mean(4.0 + sigma * hand < limit)
            assert found.false_positive.inf[i, j] == pytest.approx(feigned, abs=1e-12)
            assert found.false_negative.inf[i, j] == pytest.approx(hidden, abs=1e-12)


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


def test_same_seed_gives_same_rates() -> None:
    assert np.array_equal(_rates().false_positive.inf, _rates().false_positive.inf)
    other = _rates(generator=np.random.default_rng(8))
    assert not np.array_equal(_rates().false_positive.inf, other.false_positive.inf)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"noise": [-1.0]}, "noise must be >= 0"),
        ({"noise": [math.nan]}, "noise must be one axis"),
        ({"threshold": [[1.0]]}, "threshold must be one axis"),
        ({"threshold": [math.inf]}, "threshold must be one axis"),
        ({"noise": "much"}, "noise: could not convert"),
        ({"touched": None}, "touched: "),
        ({"draws": 0}, "draws must be >= 1"),
        ({"touched": [1.0, 2.0]}, "touched must be one"),
        ({"untouched": Interval(-math.inf, 0.0)}, "untouched must be one"),
    ],
)
def test_settings_that_make_no_curve_are_refused(changed: dict[str, Any], said: str) -> None:
    with pytest.raises(IntervalError, match=said):
        _rates(**changed)


def test_a_reading_on_the_threshold_counts_as_a_touch() -> None:
    class Still:
        """Draws the same few values."""

        def standard_normal(self, size: int) -> Any:
            return np.resize([-1.0, 0.0, 1.0, 2.0], size)

    found = _rates(noise=[1.0], threshold=[1.0, 4.0], draws=4, generator=Still())
    assert found.false_positive.inf.tolist() == [[0.5, 0.0]]
    assert found.false_negative.inf.tolist() == [[0.0, 0.25]]
