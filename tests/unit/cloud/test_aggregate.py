"""Aggregates against brute force; stored bounds against messages."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from eskin_cloud.rollup.blocks import Buckets, decode, fold
from eskin_cloud.store.damage import RowHeader
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.write.block_row import BlockRow
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.runtime.digest import digest
from eskin.wire.messages import Block, Encoding
from eskin.wire.messages.stored_bounds import read_bounds
from tests.unit.cloud.messages import START, block

VALUES = st.sampled_from([-1e300, -2.0, -0.1, 0.0, 5e-324, 0.1, 0.3, 1e300])
SIDES = st.tuples(VALUES, VALUES, st.sampled_from(["", "", "", "lo", "hi", "both"]))


@st.composite
def spoken(draw: st.DrawFn) -> list[Block]:
    """Blocks one behind the other, with gaps now and then, seldom over each other."""
    said, t = [], START
    for number in range(draw(st.integers(1, 6))):
        sides = draw(st.lists(SIDES, min_size=1, max_size=12))
        lo = [-np.inf if open_ in {"lo", "both"} else min(a, b) for a, b, open_ in sides]
        hi = [np.inf if open_ in {"hi", "both"} else max(a, b) for a, b, open_ in sides]
        dt, error = draw(st.sampled_from([1, 3, 10])), draw(st.integers(0, 2))
        coverage = draw(st.sampled_from([1.0, 0.999]))
        time = (t - error, t + error)
        said.append(block(number, lo, hi, time=time, dt=dt, coverage=coverage))
        t += dt * len(lo) + draw(st.sampled_from([0, 0, 3, dt, 40, -5]))
    return sorted(said, key=lambda one: (one.tube.first_moment, one.position))


def rows(said: list[Block]) -> list[tuple[Any, ...]]:
    """As the store gives them."""
    return [
        (
            *(each.first_moment, each.dt, len(each), each.time_error, each.coverage, data),
            *(head["head"], *RowHeader.of(head)),
        )
        for one in said
        for each, data in [(one.tube, one.encode())]
        for head in [BlockRow.of("node", one.summary, data, digest(data), 0, 0)._asdict()]
    ]


@settings(max_examples=60, deadline=None)
@given(spoken(), st.integers(-5, 60), st.integers(1, 150), st.integers(1, 40))
def test_aggregates_equal_brute_force(said: list[Block], begin: int, span: int, width: int) -> None:
    window = Window(START + begin, START + begin + span)
    buckets = Buckets(window.start - 3, width, -(-(span + 3) // width))
    found = fold(rows(said), window, buckets)
    samples = decode(rows(said), window)
    number = buckets.of(samples.first)
    assert buckets.of(found.first).tolist() == sorted(set(number.tolist()))
    for k, bucket in enumerate(buckets.of(found.first).tolist()):
        here = samples[number == bucket]
        steps, dt = np.diff(here.first), here.dt[:-1]
        assert (found.first[k], found.last[k]) == (here.first[0], here.first[-1])
        assert (found.n[k], found.dt[k]) == (len(here), here.dt[-1])
        assert found.breaks[k] == (steps > dt + dt // 2).sum()
        assert found.held[k] == np.minimum(steps, dt).sum()
        assert found.error[k] == here.error.max()
        assert (found.lo[k], found.hi[k]) == (here.lo.min(), here.hi.max())
        assert found.coverage[k] == here.coverage.min()
        assert exact(here.lo) >= found.sum_lo[k]
        assert exact(here.hi) <= found.sum_hi[k]


def exact(numbers: Any) -> Fraction | float:
    """Their sum."""
    open_ = [float(x) for x in numbers if math.isinf(x)]
    return open_[0] if open_ else sum((Fraction(float(x)) for x in numbers), Fraction())


@pytest.mark.parametrize("encoding", Encoding)
@pytest.mark.parametrize("scale", [1.0, 1e-12, 1e-310, 1e300])
def test_stored_bounds_equal_the_message(encoding: Encoding, scale: float) -> None:
    lo = np.array([0.5, -np.inf, 1.0, -np.inf, -3.0]) * scale
    hi = np.array([0.75, 2.0, np.inf, np.inf, -2.0]) * scale
    said = block(2**40, lo, hi, channel="t01.x", unit="Pa", encoding=encoding)
    found = read_bounds(said.encode())
    assert found[0].tolist() == said.tube.values.inf.tolist()
    assert found[1].tolist() == said.tube.values.sup.tolist()


@pytest.mark.parametrize(("step", "breaks"), [(10, 0), (15, 0), (16, 1)])
def test_half_a_period_late_is_no_gap(step: int, breaks: int) -> None:
    later = START + 10 + step
    said = [block(0, [1, 1], [2, 2], dt=10), block(1, [1], [2], time=(later, later), dt=10)]
    found = fold(rows(said), Window(START, START + 100), Buckets(START, 100, 1))
    assert (found.n.tolist(), found.breaks.tolist(), found.held.tolist()) == ([3], [breaks], [20])
