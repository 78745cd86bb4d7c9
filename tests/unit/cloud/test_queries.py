"""Series against brute force over raw samples."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.query.series import Series, read_series
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eskin.monitor import parse
from eskin.union_bound import union_coverage
from tests.support.examples import examples
from tests.unit.cloud.brute_force import verdicts_of
from tests.unit.cloud.clouds import emptied, put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch, tube_of

if TYPE_CHECKING:
    from eskin_cloud.store import Store

    from eskin.wire.frames import Frame

_BOUNDS = st.sampled_from([-math.inf, -2.0, -0.1, 0.0, 0.1, 0.3, 1.0, 1.5, 3.0, math.inf])


@dataclass(frozen=True)
class Sample:
    """One sample, as brute force sees it."""

    t: int
    dt: int
    lo: float
    hi: float


@st.composite
def stretches(draw: st.DrawFn) -> list[Frame]:
    """Frames of several boots, with gaps and overlaps."""
    made = []
    for sequence in range(draw(st.integers(1, 8))):
        pairs = draw(st.lists(st.tuples(_BOUNDS, _BOUNDS), min_size=1, max_size=9))
        lo = [min(pair) for pair in pairs]
        hi = [max(pair) for pair in pairs]
        lo = [-math.inf if bound == math.inf else bound for bound in lo]
        hi = [math.inf if bound == -math.inf else bound for bound in hi]
        first = START + draw(st.integers(0, 400))
        error = draw(st.integers(0, 3))
        made.append(
            stretch(
                sequence,
                lo,
                hi,
                boot=draw(st.integers(1, 3)),
                time=(first, first + error),
                dt=draw(st.sampled_from([10, 10, 7, 1])),
                coverage=draw(st.sampled_from([1.0, 0.99, 0.9])),
            )
        )
    return draw(st.permutations(made))


windows = st.builds(
    lambda start, span: Window(START + start, START + start + span),
    st.integers(-30, 450),
    st.integers(0, 500),
)


def samples_of(said: list[Frame]) -> list[Sample]:
    """All samples in order of time."""
    ordered = sorted(said, key=lambda each: (tube_of(each).first_instant, each.position))
    found = [
        Sample(int(t), tube.dt, float(lo), float(hi))
        for tube in map(tube_of, ordered)
        for t, lo, hi in zip(tube.instants, tube.values.inf, tube.values.sup, strict=True)
    ]
    return sorted(found, key=lambda sample: sample.t)


def within(said: list[Frame], window: Window) -> list[Sample]:
    """Samples in the window."""
    return [s for s in samples_of(said) if window.start <= s.t < window.end]


def is_gap(before: Sample, after: Sample) -> bool:
    """Whether nothing is known between two samples."""
    return after.t - before.t > before.dt + before.dt // 2


def ask(store: Store, said: list[Frame], window: Window, points: int) -> Series:
    """Ask a store that holds this alone."""
    put(emptied(store), *said)
    put(store, *said[::-1])
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        return read_series(connection, row, window, points=points)


def check_samples(series: Series, expected: list[Sample]) -> None:
    entries: list[tuple[int, float, float]] = []
    for sample, following in itertools.zip_longest(expected, expected[1:]):
        entries.append((sample.t, sample.lo, sample.hi))
        if following is not None and is_gap(sample, following):
            entries.append((sample.t + sample.dt, -math.inf, math.inf))
    times = (series.t + series.t0).tolist()
    assert list(zip(times, series.lo.tolist(), series.hi.tolist(), strict=True)) == entries


def check_hull(series: Series, said: list[Frame], window: Window) -> None:
    starts = (series.t + series.t0).tolist()
    assert starts[0] == window.start
    assert starts[-1] < window.end <= starts[-1] + series.dt
    largest = 0
    for start, lo, hi in zip(starts, series.lo, series.hi, strict=True):
        inside = within(said, Window(start, start + series.dt))
        largest = max(largest, len(inside))
        assert lo == min((s.lo for s in inside), default=-math.inf)
        assert hi == max((s.hi for s in inside), default=math.inf)
    touched = Window(window.start, starts[-1] + series.dt)
    least = min(tube_of(each).coverage for each in said if within([each], touched))
    assert series.coverage == union_coverage(least, n=largest)


@settings(
    max_examples=examples(60),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(said=stretches(), window=windows, points=st.integers(1, 20))
def test_series_equals_brute_force(
    store: Store, said: list[Frame], window: Window, points: int
) -> None:
    series = ask(store, said, window, points)
    expected = within(said, window)
    if len(expected) <= points:
        assert series.resolution == "sample"
        check_samples(series, expected)
    else:
        assert series.resolution == "hull"
        assert len(series.t) <= points
        check_hull(series, said, window)
    used = [tube_of(each) for each in said if within([each], window)]
    assert series.time_error >= max((tube.time_error for tube in used), default=0)


@pytest.mark.parametrize(("late", "gap"), [(15, False), (16, True)])
def test_sample_more_than_half_a_period_late_begins_after_a_gap(
    store: Store,
    late: int,
    gap: bool,  # noqa: FBT001 - a row of the table
) -> None:
    later = START + 10 + late
    put(
        store,
        stretch(0, [1.0, 1.0], [2.0, 2.0], time=(START, START), dt=10),
        stretch(1, [1.0], [2.0], time=(later, later), dt=10),
    )
    formula = parse(f"{CHANNEL} > 0")
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        series = read_series(connection, row, Window(START, START + 100), points=10)
        pieces = verdicts_of(connection, row, Window(START, START + 10 + late), formula)
    assert series.t.tolist() == [0, 10, *([20] if gap else []), 10 + late]
    assert [piece.missing for piece in pieces] == ([False, True] if gap else [False])
