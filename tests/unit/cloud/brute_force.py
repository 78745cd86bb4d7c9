"""All samples of a channel, and the expected answers."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
from eskin_cloud.query.channel_runs import ChannelSource
from eskin_cloud.query.series import Series, read_series
from eskin_cloud.query.stored_verdicts import StoredVerdicts
from eskin_cloud.query.verdict_totals import total_verdicts
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.removal import PatchSweep, remove_rows
from eskin_cloud.store.schema.frame_tables import stale_patch_chunks
from sqlalchemy import func, select

from eskin.monitor import Signal, evaluate, parse
from eskin.union_bound import union_coverage
from tests.unit.cloud.messages import CHANNEL, NODE, START, skin_of, tube_of

if TYPE_CHECKING:
    from eskin_cloud.query.stored_verdicts import StoredPiece
    from eskin_cloud.store import Store
    from eskin_cloud.store.read.lookup import Channel
    from numpy.typing import NDArray
    from sqlalchemy import Connection

    from eskin.monitor import Formula
    from eskin.wire.frames import Frame

QUESTIONS = tuple(
    parse(text.replace("x", CHANNEL))
    for text in (
        *("x > 0.2", "x < -1", "x >= 0 and x <= 0.3", "x < -0.1 or x > 0.1", "x > 1e301"),
        *("once[0,1us] x > 0.2", "always[0,50ns] x < 0.3"),
    )
)
BOUNDS = (-np.inf, -3.0, -0.1, 0.1, 0.3, 1e300, np.inf)


class Truth:
    """All samples, as brute force sees them: in order of time."""

    def __init__(self, said: list[Frame]) -> None:
        said = sorted(said, key=lambda frame: (tube_of(frame).first_instant, frame.position))
        tubes = [tube_of(frame) for frame in said]
        t = np.concatenate([tube.instants for tube in tubes])
        order = np.argsort(t, kind="stable")
        self.dt = np.concatenate([np.full(len(tube), tube.dt) for tube in tubes])[order]
        self.t = t[order]
        self.lo = np.concatenate([tube.values.inf for tube in tubes])[order]
        self.hi = np.concatenate([tube.values.sup for tube in tubes])[order]
        errors = [np.full(len(tube), tube.time_error) for tube in tubes]
        self.error = np.concatenate(errors)[order]
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


def verdicts_of(
    connection: Connection, channel: Channel, window: Window, formula: Formula, **limits: int
) -> list[StoredPiece]:
    """The verdicts of a formula over one channel, whatever that is called."""
    (name,) = formula.channels
    sources = {name: ChannelSource(connection, channel)}
    return list(StoredVerdicts(formula, sources, most_reads=10**6, **limits).pieces(window))


def check_states(store: Store, truth: Truth, window: Window, formula: Formula) -> None:
    """Verdicts against those of all samples, and totals of them."""
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        pieces = verdicts_of(connection, row, window, formula)
    t, first = np.unique(truth.t, return_index=True)  # samples of one time are one sample
    error, lo, hi, dt = (
        reduce.reduceat(column, first)
        for reduce, column in (
            *((np.maximum, truth.error), (np.minimum, truth.lo)),
            *((np.maximum, truth.hi), (np.maximum, truth.dt)),
        )
    )
    earliest = np.maximum.accumulate(t - error)
    gap = np.append(np.diff(t) > dt[:-1] + dt[:-1] // 2, False)
    signal = Signal(earliest, np.maximum(t + error, earliest), lo, hi, dt, gap, unit="F")
    expected = evaluate(formula, {CHANNEL: signal})
    starts = np.array([piece.first for piece in pieces], np.int64)
    assert starts.tolist() == [2 * window.start, *(piece.last + 1 for piece in pieces)][:-1]
    inside = expected.ticks[(expected.ticks > 2 * window.start) & (expected.ticks < 2 * window.end)]
    ticks = np.unique(np.concatenate([starts, inside]))
    codes = np.array([piece.verdict for piece in pieces])
    found = codes[np.searchsorted(starts, ticks, side="right") - 1]
    assert found.tolist() == expected.codes_at_ticks(ticks).tolist()
    totals = total_verdicts(pieces)
    spent = [0, 0, 0]
    ends = np.append(ticks[1:], 2 * window.end)
    for begin, end, code in zip(ticks.tolist(), ends.tolist(), found.tolist(), strict=True):
        spent[code] += end // 2 - begin // 2
    assert totals.time[0] == spent[2]
    assert totals.time[1] + totals.unknown == spent[1] + spent[2]


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
