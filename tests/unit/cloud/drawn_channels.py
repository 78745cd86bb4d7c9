"""Drawn samples of two channels, with gaps, overlaps and clocks, and signals within them."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eskin_cloud.store.read.window import Window
from hypothesis import strategies as st

from eskin.monitor import Signal
from tests.unit.cloud.messages import START, stretch, tube_of

if TYPE_CHECKING:
    import numpy as np

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
        time = first, first + 2 * draw(st.sampled_from([0, 0, 1, 4, 30, 400]))
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
    for each in sorted(said, key=lambda one: (tube_of(one).first_instant, one.position)):
        tube = tube_of(each)
        bounds = zip(tube.instants.tolist(), tube.values.inf, tube.values.sup, strict=True)
        found += [Sample(t, tube.dt, tube.time_error, lo, hi) for t, lo, hi in bounds]
    return sorted(found, key=lambda sample: sample.t)


def is_gap(before: Sample, after: Sample) -> bool:
    return after.t - before.t > before.dt + before.dt // 2


def drawn_signal(random: np.random.Generator, samples: list[Sample]) -> Signal | None:
    """A signal within the samples' intervals: exact instants and values.

    ``None`` where no instants within the enclosures ascend.
    """
    instants: list[int] = []
    latest = [min(s.t + s.error for s in samples[k:]) for k in range(len(samples))]
    for k, sample in enumerate(samples):
        earliest = max(sample.t - sample.error, instants[-1] + 1 if instants else -(2**62))
        room = min(end - n for n, end in enumerate(latest[k:]))
        if earliest > room:
            return None
        instants.append(int(random.integers(earliest, room + 1)))
    gap = [is_gap(one, other) for one, other in itertools.pairwise(samples)]
    values = [random.uniform(max(s.lo, -9.0), min(s.hi, 9.0)) for s in samples]
    periods = [sample.dt for sample in samples]
    return Signal(instants, instants, values, values, periods, [*gap, False], unit="F")
