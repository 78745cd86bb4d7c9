"""Comparisons of two channels against brute force over raw samples, and against drawn truths."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from eskin_cloud.query.comparison import find_comparison_segments
from eskin_cloud.query.comparison_segments import total_comparison
from eskin_cloud.query.neighbourhood import ChannelSource
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eskin.interval import Verdict
from tests.support.examples import examples
from tests.unit.cloud.clouds import emptied, put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch, tube_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_cloud.query.comparison_segments import ComparisonSegment
    from eskin_cloud.store import Store

    from eskin.wire.frames import Frame

OTHER = "t02.capacitance"
_BOUNDS = st.sampled_from([-math.inf, -2.0, 0.0, 0.1, 0.3, 1.0, 3.0, math.inf])


@dataclass(frozen=True)
class Sample:
    """One sample, as brute force sees it."""

    t: int
    dt: int
    error: int
    lo: float
    hi: float


@st.composite
def said_of(draw: st.DrawFn, channel: str) -> list[Frame]:
    """Frames of one channel with gaps, overlaps and clocks that know more or less."""
    made = []
    for sequence in range(draw(st.integers(1, 4))):
        pairs = draw(st.lists(st.tuples(_BOUNDS, _BOUNDS), min_size=1, max_size=6))
        lo = [min(min(pair), 3.0) for pair in pairs]
        hi = [max(max(pair), -2.0) for pair in pairs]
        first = START + draw(st.integers(0, 150))
        time = first, first + 2 * draw(st.sampled_from([0, 0, 1, 4, 30]))
        dt = draw(st.sampled_from([10, 10, 7, 1, 25]))
        number = 2 * sequence + (channel == OTHER)
        made.append(stretch(number, lo, hi, time=time, dt=dt, channel=channel))
    return draw(st.permutations(made))


windows = st.builds(
    lambda start, span: Window(START + start, START + start + span),
    st.integers(-40, 200),
    st.integers(0, 250),
)


def samples_of(said: list[Frame]) -> list[Sample]:
    """All samples in order of time."""
    found = []
    for each in sorted(said, key=lambda one: (tube_of(one).first_moment, one.position)):
        tube = tube_of(each)
        bounds = zip(tube.moments.tolist(), tube.values.inf, tube.values.sup, strict=True)
        found += [Sample(t, tube.dt, tube.time_error, lo, hi) for t, lo, hi in bounds]
    return sorted(found, key=lambda sample: sample.t)


def is_gap(before: Sample, after: Sample) -> bool:
    return after.t - before.t > before.dt + before.dt // 2


class Truth:
    """When each sample may hold, by the definition, one by one."""

    def __init__(self, samples: list[Sample]) -> None:
        n = len(samples)
        self.samples = samples
        self.earliest = [max(s.t - s.error for s in samples[: k + 1]) for k in range(n)]
        self.latest = [min(s.t + s.error for s in samples[k:]) for k in range(n)]
        ends = [k for k in range(n) if k == n - 1 or is_gap(samples[k], samples[k + 1])]
        self.end = [
            min(
                self.latest[k] + samples[k].dt if k in ends else math.inf,
                self.latest[k + 1] if k < n - 1 else math.inf,
            )
            for k in range(n)
        ]
        begins = [0, *(k + 1 for k in ends[:-1])]
        self.known = [
            (self.latest[begin], self.earliest[end] + samples[end].dt)
            for begin, end in zip(begins, ends, strict=True)
        ]

    def holding(self, moment: int) -> list[int]:
        return [k for k in range(len(self.samples)) if self.earliest[k] <= moment < self.end[k]]

    def is_known(self, moment: int) -> bool:
        return any(start <= moment < end for start, end in self.known)

    def hull(self, moment: int) -> tuple[float, float]:
        held = [self.samples[k] for k in self.holding(moment)]
        return min(s.lo for s in held), max(s.hi for s in held)


def brute_answer(one: Truth, other: Truth, moment: int) -> Verdict | None:
    if not (one.is_known(moment) and other.is_known(moment)):
        return None
    (lo, hi), (other_lo, other_hi) = one.hull(moment), other.hull(moment)
    return Verdict(int(lo > other_hi) + int(hi > other_lo))


def brute_stretches(
    one: Truth, other: Truth, window: Window
) -> Iterator[tuple[int, int, Verdict | None, int]]:
    """Moment by moment: start, end, answer, and samples that may hold, less one."""
    start, held = window.start, [set[int](), set[int]()]
    for moment in range(window.start, window.end):
        answer = brute_answer(one, other, moment)
        for each, truth in zip(held, (one, other), strict=True):
            each.update(truth.holding(moment))
        last = moment == window.end - 1
        if last or brute_answer(one, other, moment + 1) is not answer:
            yield start, moment + 1, answer, sum(map(len, held)) - 1
            start, held = moment + 1, [set(), set()]


def ask(store: Store, window: Window) -> list[ComparisonSegment]:
    with store.read() as connection:
        one, other = (
            ChannelSource(connection, find_channel(connection, NODE, channel))
            for channel in (CHANNEL, OTHER)
        )
        return list(find_comparison_segments(one, other, window))


@settings(
    max_examples=examples(40),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(one=said_of(CHANNEL), other=said_of(OTHER), window=windows)
def test_comparison_equals_brute_force(
    store: Store, one: list[Frame], other: list[Frame], window: Window
) -> None:
    put(emptied(store), *one, *other)
    found = ask(store, window)
    expected = list(brute_stretches(Truth(samples_of(one)), Truth(samples_of(other)), window))
    assert [(s.start, s.end, s.answer) for s in found] == [each[:3] for each in expected]
    possible = [(s.slots, s.start) for s in found if s.answer is Verdict.POSSIBLE]
    assert possible == [(e[3], e[0]) for e in expected if e[2] is Verdict.POSSIBLE]


def drawn_truth(random: np.random.Generator, samples: list[Sample]) -> list[tuple[int, int, float]]:
    """A signal within the samples' intervals: from when to when each of its values holds."""
    truth = Truth(samples)  # taken in order: no sample before what surely came before it
    bounds = zip(truth.earliest, truth.latest, strict=True)
    moments = sorted(int(random.integers(early, late + 1)) for early, late in bounds)
    signal = []
    for k, (begun, sample) in enumerate(zip(moments, samples, strict=True)):
        end = begun + sample.dt
        if k + 1 < len(samples):
            gap = is_gap(sample, samples[k + 1])
            end = min(end, moments[k + 1]) if gap else moments[k + 1]
        value = float(random.uniform(max(sample.lo, -9.0), min(sample.hi, 9.0)))
        signal.append((begun, end, value))
    return signal


def value_at(signal: list[tuple[int, int, float]], moment: int) -> float | None:
    held = [value for begun, end, value in signal if begun <= moment < end]
    return held[-1] if held else None


@settings(
    max_examples=examples(25),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(one=said_of(CHANNEL), other=said_of(OTHER), window=windows, seed=st.integers(0, 2**32))
def test_every_signal_and_every_clock_within_the_intervals_agrees(
    store: Store, one: list[Frame], other: list[Frame], window: Window, seed: int
) -> None:
    put(emptied(store), *one, *other)
    found = ask(store, window)
    random = np.random.default_rng(seed)
    signals = [drawn_truth(random, samples_of(said)) for said in (one, other)]
    above, entries, before = 0, 0, False
    for segment in found:
        for moment in range(segment.start, segment.end):
            if segment.answer is None:
                before = False
                continue
            mine, others = (value_at(signal, moment) for signal in signals)
            assert mine is not None
            assert others is not None
            is_above = mine > others
            assert is_above or segment.answer is not Verdict.CERTAIN
            assert not (is_above and segment.answer is Verdict.IMPOSSIBLE)
            above, entries, before = above + is_above, entries + (is_above > before), is_above
    standing = total_comparison(found)
    assert standing.time[0] <= above <= standing.time[1]
    assert standing.entries[0] <= entries <= standing.entries[1]
    assert standing.unknown == sum(s.end - s.start for s in found if s.answer is None)
