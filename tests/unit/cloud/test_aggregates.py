"""Aggregates against brute force."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.rollup.buckets import Buckets
from eskin_cloud.rollup.samples import read_buckets
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.unit.cloud.brute_force import Truth
from tests.unit.cloud.clouds import emptied, put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch, tube_of

if TYPE_CHECKING:
    from eskin_cloud.rollup.aggregates import Aggregates
    from eskin_cloud.store import Store

    from eskin.wire.frames import Frame

VALUES = st.sampled_from([-1e300, -2.0, -0.1, 0.0, 5e-324, 0.1, 0.3, 1e300])
SIDES = st.tuples(VALUES, VALUES, st.sampled_from(["", "", "", "lo", "hi", "both"]))


@st.composite
def spoken(draw: st.DrawFn) -> list[Frame]:
    """Frames one behind the other, with gaps now and then, seldom over each other."""
    said, t = [], START
    for number in range(draw(st.integers(1, 6))):
        sides = draw(st.lists(SIDES, min_size=1, max_size=12))
        lo = [-np.inf if open_ in {"lo", "both"} else min(a, b) for a, b, open_ in sides]
        hi = [np.inf if open_ in {"hi", "both"} else max(a, b) for a, b, open_ in sides]
        dt, error = draw(st.sampled_from([1, 3, 10])), draw(st.integers(0, 2))
        coverage = draw(st.sampled_from([1.0, 0.999]))
        time = (t - error, t + error)
        said.append(stretch(number, lo, hi, time=time, dt=dt, coverage=coverage))
        t += dt * len(lo) + draw(st.sampled_from([0, 0, 3, dt, 40, -5]))
    return sorted(said, key=lambda one: (tube_of(one).first_instant, one.position))


def fold(store: Store, said: list[Frame], window: Window, buckets: Buckets) -> Aggregates:
    """A window's samples, one entry for each bucket."""
    put(emptied(store), *said)
    with store.read() as connection:
        return read_buckets(connection, find_channel(connection, NODE, CHANNEL), window, buckets)


@settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(said=spoken(), begin=st.integers(-5, 60), span=st.integers(1, 150), width=st.integers(1, 40))
def test_aggregates_equal_brute_force(
    store: Store, said: list[Frame], begin: int, span: int, width: int
) -> None:
    window = Window(START + begin, START + begin + span)
    buckets = Buckets(window.start - 3, width, -(-(span + 3) // width))
    found = fold(store, said, window, buckets)
    truth = Truth(said)
    inside = truth.within(window)
    number = buckets.of(truth.t[inside])
    assert buckets.of(found.first).tolist() == sorted(set(number.tolist()))
    for k, bucket in enumerate(buckets.of(found.first).tolist()):
        here = inside.start + np.flatnonzero(number == bucket)
        t, dt = truth.t[here], truth.dt[here]
        lo, hi = truth.lo[here], truth.hi[here]
        steps = np.diff(t)
        assert (found.first[k], found.last[k]) == (t[0], t[-1])
        assert (found.n[k], found.dt[k]) == (t.size, dt[-1])
        assert found.breaks[k] == (steps > dt[:-1] + dt[:-1] // 2).sum()
        assert found.error[k] <= truth.error.max()
        assert (found.lo[k], found.hi[k]) == (lo.min(), hi.max())
        assert found.coverage[k] == truth.coverage[here].min()
        assert exact(lo) >= found.sum_lo[k]
        assert exact(hi) <= found.sum_hi[k]


def exact(numbers: Any) -> Fraction | float:
    """Their sum."""
    open_ = [float(x) for x in numbers if math.isinf(x)]
    return open_[0] if open_ else sum((Fraction(float(x)) for x in numbers), Fraction())


@pytest.mark.parametrize(("step", "breaks"), [(10, 0), (15, 0), (16, 1)])
def test_half_a_period_late_is_no_gap(store: Store, step: int, breaks: int) -> None:
    later = START + 10 + step
    said = [stretch(0, [1, 1], [2, 2], dt=10), stretch(1, [1], [2], time=(later, later), dt=10)]
    found = fold(store, said, Window(START, START + 100), Buckets(START, 100, 1))
    assert (found.n.tolist(), found.breaks.tolist()) == ([3], [breaks])
