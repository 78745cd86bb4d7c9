"""The pyramid against brute force over raw samples, while blocks come in any order and go again."""

from __future__ import annotations

import asyncio
from fractions import Fraction
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import func, select

from cloud.chore import repeat
from cloud.pyramid.building import build
from cloud.pyramid.keeping import keep_built
from cloud.query.occupancy import measure_occupancy, sum_up
from cloud.query.places import find_channel
from cloud.query.question import Answer, Question
from cloud.query.runs import Run, merge
from cloud.query.series import Series, read_series, union_coverage
from cloud.query.threshold import find_segments
from cloud.query.window import Window
from cloud.store.grid import MOST_CHUNKS
from cloud.store.removal import Reason, Sweep, remove
from cloud.store.tiles import stale, tiles
from tests.cloud.clouds import put
from tests.cloud.messages import CHANNEL, NODE, START, block
from tests.cloud.test_queries import spy_on_decoding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cloud.store import Store
    from eskin.messages import Block
    from tests.cloud.clouds import Stand

SPAN = 2_000_000
"""Of all blocks, in ns: 120 chunks of tiles at a sampling period of 1 ns."""
QUESTIONS = (
    Question(0.2, None, strict=True),
    Question(None, -1.0, strict=True),
    Question(0.0, 0.3),
    Question(-0.1, 0.1, outside=True),
    Question(1e301, None, strict=True),
)
BOUNDS = (-np.inf, -3.0, -0.1, 0.1, 0.3, 1e300, np.inf)


def drawn(random: np.random.Generator, sequence: int, first: int, last: int) -> Block:
    """A block somewhere in a stretch of time, of a node that starts anew now and then."""
    n = int(random.integers(1, 1000))
    sides = np.sort(random.choice(BOUNDS[1:-1], (2, n)), axis=0)
    sides[0][random.random(n) < 0.001], sides[1][random.random(n) < 0.001] = -np.inf, np.inf
    begin = START + int(random.integers(first, last))
    return block(
        sequence,
        *sides,
        boot=int(random.integers(1, 4)),
        time=(begin, begin + int(random.integers(0, 5))),
        dt=int(random.choice([1, 1, 1, 2, 30])),
        coverage=float(random.choice([1.0, 0.9999999])),
    )


class Truth:
    """All samples, as brute force sees them: in order of time."""

    def __init__(self, said: list[Block]) -> None:
        said = sorted(said, key=lambda b: (b.tube.first_moment, b.position))
        t = np.concatenate([b.tube.moments for b in said])
        order = np.argsort(t, kind="stable")
        self.dt = np.concatenate([np.full(len(b.tube), b.tube.dt) for b in said])[order]
        self.t = t[order]
        self.lo = np.concatenate([b.tube.values.inf for b in said])[order]
        self.hi = np.concatenate([b.tube.values.sup for b in said])[order]
        self.error = max(b.tube.time_error for b in said)
        coverage = [np.full(len(b.tube), b.tube.coverage) for b in said]
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
    assert series.coverage == union_coverage(float(least), largest)


@pytest.mark.parametrize(("seed", "few"), [(0, 600), (1, 3)])
def test_buckets_equal_brute_force_whatever_comes_and_goes(
    store: Store, monkeypatch: pytest.MonkeyPatch, seed: int, few: int
) -> None:
    monkeypatch.setattr("cloud.pyramid.blocks._FEW", few)
    random = np.random.default_rng(seed)
    said = [block(0, [0.1], [0.3], time=(START, START), dt=1)]
    put(store, *said)
    for step in range(3):
        begin = int(random.integers(0, SPAN))
        end = int(random.integers(begin + 1, SPAN + 1))
        fresh = [
            drawn(random, 100 * step + k, begin, end) for k in range(1, random.integers(2, 30))
        ]
        said += fresh
        for part in (fresh[:10], fresh[10:]):
            put(store, *part)
            if random.random() < 0.5:
                build(store)
        if random.random() < 0.3:
            before = START + int(random.integers(0, SPAN // 4))
            said = [b for b in said if b.tube.moments[-1] + b.tube.time_error >= before]
            _remove(store, before)
        check(store, Truth(said), random)


@pytest.mark.parametrize("seed", range(2))
def test_rates_far_apart_are_built_in_few_chunks_and_answer_as_brute_force(
    store: Store, seed: int
) -> None:
    random = np.random.default_rng(seed)
    said = [block(0, [0.1], [0.3], time=(START, START), dt=1)]
    put(store, *said)
    grains = [_grain(store)]
    for number in range(1, 8):
        dt = int(random.choice([1, 900, 10**6, 10**9, 10**12]))
        n = int(random.choice([1, 5, 300, 1000]))
        sides = np.sort(random.choice(BOUNDS[1:-1], (2, n)), axis=0)
        begin = START + int(random.integers(0, 10 ** int(random.integers(3, 15))))
        said.append(block(number, *sides, time=(begin, begin), dt=dt))
        put(store, said[-1])
        if random.random() < 0.7:
            build(store)
        if random.random() < 0.2:
            before = START + int(random.integers(0, 10**12))
            said = [b for b in said if b.tube.moments[-1] + b.tube.time_error >= before]
            _remove(store, before)
        grains.append(_grain(store))
        assert _marked(store) <= MOST_CHUNKS * number
        if not said:
            continue
        truth = Truth(said)
        first, last = np.sort(random.choice(truth.t, 2)).tolist()
        window = Window(first, last + 1 + int(random.integers(10**6)))
        check_states(store, truth, window, QUESTIONS[int(random.integers(len(QUESTIONS)))])
        series = ask(store, window, 100)
        if series.resolution == "hull":
            compare(series, truth, window, 100)
    build(store)
    assert _marked(store) == 0
    assert grains == sorted(grains)


def test_rate_a_thousand_times_lower_keeps_the_tiles(store: Store) -> None:
    values = np.zeros(250), np.ones(250)
    put(store, block(0, *values, time=(START, START), dt=1_000_000))
    grain = _grain(store)
    put(store, block(1, *values, time=(START + 10**9,) * 2, dt=1_000_000_000))
    build(store)
    put(store, block(2, *values, time=(START + 2 * 10**9,) * 2, dt=1_000_000_000))
    assert _marked(store) > 0, "the second one is late"
    assert _grain(store) == grain


def _grain(store: Store) -> int:
    with store.read() as connection:
        return int(find_channel(connection, NODE, CHANNEL)["grain"])


def _marked(store: Store) -> int:
    with store.read() as connection:
        return int(connection.execute(select(func.count()).select_from(stale)).scalar_one())


def check(store: Store, truth: Truth, random: np.random.Generator) -> None:
    """Ask for some window."""
    start = START + int(random.integers(-SPAN // 10, SPAN // 2))
    window = Window(start, start + int(random.integers(SPAN // 20, SPAN)))
    points = int(random.choice([1, 7, 100, 1000]))
    series = ask(store, window, points)
    here = truth.within(window)
    check_states(store, truth, window, QUESTIONS[int(random.integers(len(QUESTIONS)))])
    if series.resolution == "hull":
        compare(series, truth, window, points)
    else:
        assert here.stop - here.start <= points


def check_states(store: Store, truth: Truth, window: Window, question: Question) -> None:
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


@settings(deadline=None)
@given(st.lists(st.tuples(st.sampled_from(Answer), st.booleans()), max_size=7))
def test_entries_are_those_of_every_signal_between_the_bounds(
    samples: list[tuple[Answer, bool]],
) -> None:
    runs, t = [], 0
    for answer, gap in samples:
        t += 20 if gap else 10
        runs.append(Run(t, t, answer, 10, 1, 0, 0))
    counts = set()
    for signal in product([False, True], repeat=len(runs)):
        if any(
            run.answer is not Answer.POSSIBLE and state is not (run.answer is Answer.CERTAIN)
            for run, state in zip(runs, signal, strict=True)
        ):
            continue
        before = [False, *signal][:-1]
        counts.add(
            sum(
                state and (gap or not was)
                for state, was, (_, gap) in zip(signal, before, samples, strict=True)
            )
        )
    whole = sum_up(runs, Window(0, t + 10), None)
    assert whole.entries == (min(counts), max(counts))
    assert sum_up(merge(runs), Window(0, t + 10), None).entries == whole.entries


def test_states_decode_only_blocks_that_straddle(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    levels = [0.0, 5.0, 9.5, 12.0]
    said = [
        block(n, [levels[n // 200]] * 500, [levels[n // 200] + 1] * 500, time=(at, at), dt=1)
        for n, at in ((n, START + 500 * n) for n in range(800))
    ]
    put(store, *said)
    build(store)
    decoded = spy_on_decoding(monkeypatch)
    window = Window(START + 100, START + 399_000)
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        question = Question(10.0, None, strict=True)
        found = measure_occupancy(connection, row, window, question)
    assert {levels[b.position.sequence // 200] for b in decoded} == {9.5}
    assert len({b.position for b in decoded}) == 200
    assert found.time == (99_000, 199_000)
    assert found.entries == (1, 50_001)
    decoded.clear()
    with store.read() as connection:
        measure_occupancy(connection, row, window, Question(20.0, None, strict=True))
    assert decoded == []


@pytest.mark.anyio
async def test_background_builds_what_came_and_ends_when_told(stand: Stand) -> None:
    moments = [START + n * 20_000 for n in range(5)]
    put(stand.cloud.store, *(block(n, time=(t, t), dt=1) for n, t in enumerate(moments)))
    stopping = asyncio.Event()
    building = asyncio.create_task(keep_built(stand.cloud, stopping))
    while not _levels(stand.cloud.store):  # noqa: ASYNC110 - made by the code under test
        await asyncio.sleep(0.01)
    stopping.set()
    await building
    assert min(_levels(stand.cloud.store)) == 6


@pytest.mark.anyio
async def test_work_that_broke_is_counted_and_tried_again(stand: Stand) -> None:
    stopping = asyncio.Event()
    done = 0

    async def work() -> None:
        nonlocal done
        done += 1
        if done < 3:
            raise OverflowError("nobody foresaw it")
        stopping.set()

    await repeat("work", work, cloud=stand.cloud, stopping=stopping, every_s=0.001)
    assert done == 3
    assert b'eskin_cloud_faults_total{work="work"} 2.0' in stand.cloud.metrics.write()


def _levels(store: Store) -> set[int]:
    with store.read() as connection:
        return set(connection.execute(select(tiles.c.level)).scalars())


def _remove(store: Store, before: int) -> None:
    sweep = Sweep(NODE, CHANNEL, Reason.AGE, before)
    store.write(lambda c: remove(c, store.ledger, sweep, most=500, now=START)).result(20)


def test_certain_segment_ends_at_each_gap_within_a_tile(store: Store) -> None:
    moments = [START + 100 * n for n in range(400)]
    put(
        store, *(block(n, [1.0] * 30, [2.0] * 30, time=(t, t), dt=1) for n, t in enumerate(moments))
    )
    build(store)
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        window = Window(START, START + 40_000)
        found = list(find_segments(connection, row, window, Question(0.0, None, strict=True)))
    assert [(run.start, run.end) for run in found] == [(t, t + 29) for t in moments]
