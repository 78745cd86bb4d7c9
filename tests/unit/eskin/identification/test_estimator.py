"""The estimator against its definition with 60 digits, and against true trajectories."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import IdentificationError
from eskin.identification import SetMembershipEstimator, estimate
from eskin.interval import Interval

if TYPE_CHECKING:
    from numpy.typing import NDArray

SECOND = 10**9
MINUTE = 60 * SECOND
DAY = 24 * 60 * MINUTE
LEAST, MOST = 1e-6, 1e6

SEEDS = st.integers(0, 2**32 - 1)


class Record:
    """Constraints at random instants, with bounds that may be missing, and a random drift.

    Up to ``wrong`` of any ``memory`` kept constraints do not hold the true parameter.
    """

    def __init__(self, seed: int, *, wrong: int, memory: int) -> None:
        draw = np.random.default_rng(seed)
        n = int(draw.integers(1, 60))
        self.latest = np.cumsum(draw.integers(0, 3 * MINUTE, n))
        self.latest += draw.choice([0, DAY, 400 * DAY], n, p=[0.8, 0.15, 0.05]).cumsum()
        self.earliest = self.latest - draw.integers(0, 2 * MINUTE, n) * draw.integers(0, 2)
        slow, fast = sorted(draw.choice([-1e-8, -3e-9, 0.0, 2e-9, 1e-8], 2).tolist())
        self.rates = slow, fast
        # At a true instant between both ends, strictly ascending instants are not needed.
        instants = [
            mpmath.mpf(int(draw.integers(a, b + 1)))
            for a, b in zip(self.earliest.tolist(), self.latest.tolist(), strict=True)
        ]
        self.level = mpmath.mpf(float(np.exp(draw.uniform(-3.0, 3.0))))
        self.pieces = np.sort(draw.integers(0, int(self.latest[-1]) + 2, 5)).tolist()
        self.speeds = draw.uniform(slow, fast, len(self.pieces) + 1).tolist()
        spread = 10.0 ** draw.uniform(-12.0, -1.0)
        lo, hi = [], []
        misses = np.zeros(n, bool)
        for k, instant in enumerate(instants):
            true = float(self.at(instant))
            low, high = true * (1 - spread * draw.uniform()), true * (1 + spread * draw.uniform())
            low, high = np.nextafter(low, 0.0), np.nextafter(high, np.inf)
            if wrong and draw.uniform() < 0.2 and not misses[max(0, k - 3 * memory) :].any():
                misses[k : k + 1] = True
                low, high = true * 1.2, true * 1.3
            kind = draw.integers(0, 6)
            lo.append(0.0 if kind in {0, 2} else low)
            hi.append(np.inf if kind in {1, 2} else high)
        self.bounds = Interval(lo, hi)

    def at(self, time: Any) -> Any:
        """The true parameter at a time in ns."""
        begin, log = mpmath.mpf(0), mpmath.log(self.level)
        for end, speed in zip([*self.pieces, mpmath.inf], self.speeds, strict=True):
            if time <= end or end == mpmath.inf:
                return mpmath.exp(log + mpmath.mpf(speed) * (time - begin) / SECOND)
            log += mpmath.mpf(speed) * (end - begin) / SECOND
            begin = mpmath.mpf(end)
        raise AssertionError


def defined(record: Record, time: int, *, outliers: int, memory: int) -> tuple[Any, Any] | None:
    """The hull by definition, with 60 digits: both ends, or nothing where it is empty."""
    kept: dict[int, int] = {}
    for k, latest in enumerate(record.latest.tolist()):
        informs = record.bounds.inf[k] > 0.0 or record.bounds.sup[k] < np.inf
        if latest <= time and informs:
            kept.setdefault(latest // MINUTE, k)
    widened = []
    slow, fast = (mpmath.mpf(rate) / SECOND for rate in record.rates)
    for k in list(kept.values())[-memory:]:
        ages = [time - int(record.latest[k]), time - int(record.earliest[k])]
        low = mpmath.mpf(float(record.bounds.inf[k])) * min(mpmath.exp(slow * a) for a in ages)
        high = mpmath.mpf(float(record.bounds.sup[k])) * max(mpmath.exp(fast * a) for a in ages)
        widened.append((low, high))
    points = sorted({mpmath.mpf(0), mpmath.inf, *(end for pair in widened for end in pair)})
    inside = [x for x in points if sum(not a <= x <= b for a, b in widened) <= outliers]
    return (inside[0], inside[-1]) if inside else None


@settings(max_examples=25)
@given(SEEDS, st.integers(0, 3), st.sampled_from([4, 7, 200]))
def test_enclosure_is_the_defined_hull(seed: int, outliers: int, memory: int) -> None:
    record = Record(seed, wrong=outliers, memory=memory)
    times = np.sort(
        np.concatenate([record.latest, record.latest + 40 * DAY, [int(record.latest[0])]])
    )
    found = estimate(
        record.earliest, record.latest, record.bounds, times, Interval(*record.rates),
        outliers=outliers, memory=memory,
    )  # fmt: skip
    with mpmath.workdps(60):
        for time, each in zip(times.tolist(), found, strict=True):
            expected = defined(record, time, outliers=outliers, memory=memory)
            if expected is None:
                # Rounding outward may leave some points, where all but touch.
                assert bool(each.is_empty) or float(each.wid) < 1e-13 * float(each.sup)
                continue
            for sign, bound, exact in ((1, each.inf, expected[0]), (-1, each.sup, expected[1])):
                ours = mpmath.mpf(float(bound))
                assert sign * ours <= sign * exact
                assert ours == exact or abs(ours - exact) <= 1e-13 * exact


@settings(max_examples=50)
@given(SEEDS, st.integers(0, 2), st.sampled_from([4, 7, 200]))
def test_true_trajectory_stays_inside(seed: int, outliers: int, memory: int) -> None:
    record = Record(seed, wrong=outliers, memory=memory)
    times = np.sort(np.concatenate([record.latest, record.latest + 3 * DAY]))
    found = estimate(
        record.earliest, record.latest, record.bounds, times, Interval(*record.rates),
        outliers=outliers, memory=memory,
    )  # fmt: skip
    with mpmath.workdps(60):
        for time, each in zip(times.tolist(), found, strict=True):
            assert mpmath.mpf(float(each.inf)) <= record.at(mpmath.mpf(time))
            assert record.at(mpmath.mpf(time)) <= mpmath.mpf(float(each.sup))


@given(SEEDS, st.integers(0, 3), st.sampled_from([4, 7, 200]))
def test_online_and_a_record_give_the_same(seed: int, outliers: int, memory: int) -> None:
    record = Record(seed, wrong=outliers, memory=memory)
    online = SetMembershipEstimator(Interval(*record.rates), outliers=outliers, memory=memory)
    seen = []
    for k, latest in enumerate(record.latest.tolist()):
        online.push(int(record.earliest[k]), latest, record.bounds[k])
        seen.append(online.at(latest + 17))
    order = [
        k for k, t in enumerate(record.latest) if t + 17 < np.append(record.latest, 2**61)[k + 1]
    ]
    found = estimate(
        record.earliest, record.latest, record.bounds, record.latest[order] + 17,
        Interval(*record.rates), outliers=outliers, memory=memory,
    )  # fmt: skip
    assert [str(seen[k]) for k in order] == [str(each) for each in found]
    assert all(bool(seen[k].equal(each)) for k, each in zip(order, found, strict=True))
    assert len(online) <= memory


def minutes(n: int) -> NDArray[np.int64]:
    return np.arange(n, dtype=np.int64) * MINUTE


def test_interval_shrinks_with_data_and_widens_with_time() -> None:
    draw = np.random.default_rng(3)
    n, times = 500, np.array([0, 10, 100, 499, 5000, 50_000]) * MINUTE
    lo, hi = 1.0 - draw.uniform(0.0, 0.01, n), 1.0 + draw.uniform(0.0, 0.01, n)
    found = estimate(
        minutes(n), minutes(n), Interval(lo, hi), times, Interval(-1e-9, 1e-9), outliers=0
    )
    width = found.wid
    assert width[0] > width[1] > width[2] > width[3]
    assert width[3] < width[4] < width[5]
    assert width[2] < 5e-4  # of the 1 % that one sample has


def test_wrong_sample_is_forgotten() -> None:
    lo, hi = np.full(30, 0.99), np.full(30, 1.01)
    lo[5], hi[5] = 1.2, 1.3
    lo[6], hi[6] = 1.2, 1.3
    found = estimate(
        minutes(30), minutes(30), Interval(lo, hi), minutes(30), 0.0, outliers=1, memory=10
    )
    empty = found.is_empty.tolist()
    assert empty[:6] == [False] * 6
    assert empty[7] is True
    assert empty[16:] == [False] * 14


def test_nothing_is_known_before_more_constraints_than_outliers() -> None:
    found = estimate(
        minutes(5), minutes(5), Interval(np.full(5, 1.0), np.full(5, 2.0)), minutes(5), 0.0,
        outliers=2,
    )  # fmt: skip
    assert found.inf.tolist() == [0.0, 0.0, *found.inf[2:].tolist()]
    assert found.sup.tolist()[:2] == [np.inf, np.inf]
    assert np.all(found.inf[2:] > 0.999)


def test_one_constraint_of_a_minute_counts() -> None:
    online = SetMembershipEstimator(0.0, outliers=0, memory=3)
    for k in range(60):
        online.push(k * SECOND, k * SECOND, Interval(1.0, 2.0 - 0.01 * k))
    assert len(online) == 1
    assert float(online.at(60 * SECOND).sup) >= 2.0
    online.push(MINUTE, MINUTE, Interval(-np.inf, np.inf))  # says nothing, and takes no place
    online.push(MINUTE + 1, MINUTE + 1, Interval(1.0, 1.5))
    assert len(online) == 2
    assert float(online.at(2 * MINUTE).sup) < 1.51


@pytest.mark.parametrize(
    "call",
    [
        lambda: SetMembershipEstimator(Interval(0.0, np.inf), outliers=0),
        lambda: SetMembershipEstimator(0.0, outliers=-1),
        lambda: SetMembershipEstimator(0.0, outliers=5, memory=5),
        lambda: SetMembershipEstimator(0.0, outliers=0).push(5, 4, Interval(1.0, 2.0)),
        lambda: SetMembershipEstimator(0.0, outliers=0).push(4, 5, Interval(-2.0, -1.0)),
        lambda: SetMembershipEstimator(0.0, outliers=0).push(4, 5, Interval.empty()),
        lambda: SetMembershipEstimator(0.0, outliers=0).push(4, 5, Interval([1.0], [2.0])),
        lambda: estimate([1, 0], [1, 0], Interval([1.0, 1.0]), [2], 0.0, outliers=0),
        lambda: estimate([1], [1], Interval([1.0, 1.0]), [2], 0.0, outliers=0),
        lambda: estimate([1], [1], Interval([1.0]), [2.5], 0.0, outliers=0),
    ],
)
def test_what_cannot_be_used_is_refused(call: Any) -> None:
    with pytest.raises(IdentificationError):
        call()


def test_constraints_come_in_order_and_times_after_them() -> None:
    online = SetMembershipEstimator(0.0, outliers=0)
    online.push(9, 10, Interval(1.0, 2.0))
    with pytest.raises(IdentificationError, match="in order"):
        online.push(8, 9, Interval(1.0, 2.0))
    with pytest.raises(IdentificationError):
        online.at(9)
    assert 1.5 in online.at(10)
