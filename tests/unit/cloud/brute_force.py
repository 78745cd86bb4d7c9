"""All samples of a channel, and the expected answers."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
from eskin_cloud.query.occupancy import measure_occupancy
from eskin_cloud.query.predicate import Predicate
from eskin_cloud.query.segments import find_segments
from eskin_cloud.query.series import Series, read_series
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.removal import PatchSweep, remove_rows
from eskin_cloud.store.schema.frame_tables import stale_patch_chunks
from sqlalchemy import func, select

from eskin.union_bound import union_coverage
from tests.unit.cloud.messages import CHANNEL, NODE, START, skin_of, tube_of

if TYPE_CHECKING:
    from eskin_cloud.store import Store
    from numpy.typing import NDArray

    from eskin.wire.frames import Frame

QUESTIONS = (
    Predicate(0.2, None, strict=True),
    Predicate(None, -1.0, strict=True),
    Predicate(0.0, 0.3),
    Predicate(-0.1, 0.1, outside=True),
    Predicate(1e301, None, strict=True),
)
BOUNDS = (-np.inf, -3.0, -0.1, 0.1, 0.3, 1e300, np.inf)


class Truth:
    """All samples, as brute force sees them: in order of time."""

    def __init__(self, said: list[Frame]) -> None:
        said = sorted(said, key=lambda frame: (tube_of(frame).first_moment, frame.position))
        tubes = [tube_of(frame) for frame in said]
        t = np.concatenate([tube.moments for tube in tubes])
        order = np.argsort(t, kind="stable")
        self.dt = np.concatenate([np.full(len(tube), tube.dt) for tube in tubes])[order]
        self.t = t[order]
        self.lo = np.concatenate([tube.values.inf for tube in tubes])[order]
        self.hi = np.concatenate([tube.values.sup for tube in tubes])[order]
        self.error = max(tube.time_error for tube in tubes)
        coverage = [np.full(len(tube), tube.coverage) for tube in tubes]
        self.coverage = np.concatenate(coverage)[order]

    def within(self, window: Window) -> slice:
        first, end = np.searchsorted(self.t, [window.start, window.end])
        return slice(int(first), int(end))


def ask(store: Store, window: Window, points: int) -> Series:
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        return read_series(connection, row, window, points=points)


def mean(numbers: NDArray[np.float64]) -> Fraction | float:
    """Exactly; of few different numbers."""
    found, counts = np.unique(numbers, return_counts=True)
    if np.isinf(found).any():
        return float(found[np.isinf(found)][0])
    total = sum(int(n) * Fraction(float(x)) for x, n in zip(found, counts, strict=True))
    return Fraction(total) / numbers.size


def compare(series: Series, truth: Truth, window: Window, points: int) -> None:
    """Bucket by bucket; finds nothing."""
    assert series.mean is not None
    starts = (series.t + series.t0).tolist()
    assert starts[0] <= window.start < starts[0] + series.dt
    assert starts[-1] < window.end <= starts[-1] + series.dt
    assert points / 4 <= len(starts) <= points
    largest = 0
    for start, lo, hi, low, high in zip(starts, series.lo, series.hi, *series.mean, strict=True):
        inside = truth.within(Window(start, start + series.dt))
        n = inside.stop - inside.start
        largest = max(largest, n)
        assert lo == truth.lo[inside].min(initial=np.inf if n else -np.inf)
        assert hi == truth.hi[inside].max(initial=-np.inf if n else np.inf)
        assert lo <= low <= high <= hi
        if n:
            assert low <= mean(truth.lo[inside])
            assert high >= mean(truth.hi[inside])
    whole = truth.within(Window(starts[0], starts[-1] + series.dt))
    least = truth.coverage[whole].min(initial=1.0)
    assert series.coverage == union_coverage(float(least), n=largest)


def check_states(store: Store, truth: Truth, window: Window, question: Predicate) -> None:
    """Segments, times and counts against a look at each sample."""
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        segments = list(find_segments(connection, row, window, question))
        found = measure_occupancy(connection, row, window, question)
    here = truth.within(window)
    t, dt = truth.t[here], truth.dt[here]
    answers = question.answers(truth.lo[here], truth.hi[here])
    broken = np.diff(t) > dt[:-1] + dt[:-1] // 2
    cuts = np.flatnonzero((np.diff(answers) != 0) | broken) + 1
    runs = [part for part in np.split(np.arange(t.size), cuts) if part.size]
    expected = [(t[r[0]], t[r[-1]], answers[r[0]]) for r in runs if answers[r[0]]]
    assert [(s.start, s.end, s.answer) for s in segments] == expected
    held = np.minimum(np.diff(t, append=window.end), dt)
    spans = [(answers[r[0]], int(held[r].sum())) for r in runs]
    certain, excluded = (sum(span for said, span in spans if said == each) for each in (2, 0))
    # At each end a run of one answer loses the time error there.
    least, less = (
        sum(max(0, span - 2 * truth.error) for said, span in spans if said == each)
        for each in (2, 0)
    )
    known = int(held.sum())
    assert least <= found.time[0] <= certain
    assert known - excluded <= found.time[1] <= known - less
    assert found.unknown == window.span - known
    assert found.error <= truth.error
    assert found.samples == (int((answers == 2).sum()), int((answers > 0).sum()))


def compact_all(store: Store) -> None:
    """Compact all frames, of any age and number."""
    due = Due(2**62, 2**62)
    for page in find_compactable_frames(store, due):
        while compact_frames(store, page, due):
            pass


def remove_before(store: Store, before: int) -> None:
    """Remove what ended before a time, as retention does."""
    compact_all(store)
    due = PatchSweep(NODE, skin_of()[1].patch_id, (CHANNEL,), before)
    store.write(lambda c: remove_rows(c, due, most=500, now=START)).result(120)


def lowest_level(store: Store) -> int:
    """Of the channel's pyramid."""
    with store.read() as connection:
        return int(find_channel(connection, NODE, CHANNEL)["grain"])


def count_marked(store: Store) -> int:
    """The number of stale chunks."""
    with store.read() as connection:
        return int(
            connection.execute(select(func.count()).select_from(stale_patch_chunks)).scalar_one()
        )
