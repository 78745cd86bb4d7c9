"""Rollups against brute force, while blocks arrive in any order and are removed."""

from __future__ import annotations

import asyncio
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.jobs.overview_tiles import build_rollup
from eskin_cloud.query.occupancy import measure_occupancy, total_occupancy
from eskin_cloud.query.predicate import Predicate
from eskin_cloud.query.segments import Segment, find_segments, merge
from eskin_cloud.rollup.tile_builder import build, write_levels
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.schema.tile_tables import stale_chunks, tiles
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import select

from eskin.interval import Verdict
from tests.unit.cloud.brute_force import (
    BOUNDS,
    QUESTIONS,
    Truth,
    ask,
    check_states,
    compare,
    remove_before,
)
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch
from tests.unit.cloud.test_queries import spy_on_decoding

if TYPE_CHECKING:
    from eskin_cloud.store import Store
    from sqlalchemy import Connection

    from eskin.wire.messages import Block
    from tests.unit.cloud.clouds import Stand

SPAN = 2_000_000
"""Of all blocks, in ns: 120 chunks of tiles at a sampling period of 1 ns."""


def drawn(random: np.random.Generator, sequence: int, first: int, last: int) -> Block:
    """A block somewhere in a stretch of time, of a node that starts anew now and then."""
    n = int(random.integers(1, 1000))
    sides = np.sort(random.choice(BOUNDS[1:-1], (2, n)), axis=0)
    sides[0][random.random(n) < 0.001], sides[1][random.random(n) < 0.001] = -np.inf, np.inf
    begin = START + int(random.integers(first, last))
    return stretch(
        sequence,
        *sides,
        boot=int(random.integers(1, 4)),
        time=(begin, begin + int(random.integers(0, 5))),
        dt=int(random.choice([1, 1, 1, 2, 30])),
        coverage=float(random.choice([1.0, 0.9999999])),
    )


@pytest.mark.parametrize(("seed", "few"), [(0, 600), (1, 3)])
def test_buckets_equal_brute_force(
    store: Store, monkeypatch: pytest.MonkeyPatch, seed: int, few: int
) -> None:
    monkeypatch.setattr("eskin_cloud.rollup.blocks._FEW", few)
    random = np.random.default_rng(seed)
    said = [stretch(0, [0.1], [0.3], time=(START, START), dt=1)]
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
            remove_before(store, before)
        check(store, Truth(said), random)


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


@settings(deadline=None)
@given(st.lists(st.tuples(st.sampled_from(Verdict), st.booleans()), max_size=7))
def test_entries_are_those_of_every_signal_between_the_bounds(
    samples: list[tuple[Verdict, bool]],
) -> None:
    runs, t = [], 0
    for answer, gap in samples:
        t += 20 if gap else 10
        runs.append(Segment(t, t, answer, 10, 1, 0, 0))
    counts = set()
    for signal in product([False, True], repeat=len(runs)):
        if any(
            run.answer is not Verdict.POSSIBLE and state is not (run.answer is Verdict.CERTAIN)
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
    whole = total_occupancy(runs, Window(0, t + 10), None)
    assert whole.entries == (min(counts), max(counts))
    assert total_occupancy(merge(runs), Window(0, t + 10), None).entries == whole.entries


def test_states_decode_only_undecided_blocks(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    levels = [0.0, 5.0, 9.5, 12.0]
    said = [
        stretch(n, [levels[n // 200]] * 500, [levels[n // 200] + 1] * 500, time=(at, at), dt=1)
        for n, at in ((n, START + 500 * n) for n in range(800))
    ]
    put(store, *said)
    build(store)
    decoded = spy_on_decoding(monkeypatch)
    window = Window(START + 100, START + 399_000)
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        question = Predicate(10.0, None, strict=True)
        found = measure_occupancy(connection, row, window, question)
    assert {levels[b.position.sequence // 200] for b in decoded} == {9.5}
    assert len({b.position for b in decoded}) == 200
    assert found.time == (99_000, 199_000)
    assert found.entries == (1, 50_001)
    decoded.clear()
    with store.read() as connection:
        measure_occupancy(connection, row, window, Predicate(20.0, None, strict=True))
    assert decoded == []


@pytest.mark.anyio
async def test_background_build_starts_and_stops(stand: Stand) -> None:
    moments = [START + n * 20_000 for n in range(5)]
    put(stand.cloud.store, *(stretch(n, time=(t, t), dt=1) for n, t in enumerate(moments)))
    stopping = asyncio.Event()
    building = asyncio.create_task(build_rollup(stand.cloud, stopping))
    while not _levels(stand.cloud.store):  # noqa: ASYNC110 - made by the code under test
        await asyncio.sleep(0.01)
    stopping.set()
    await building
    assert min(_levels(stand.cloud.store)) == 6


def _levels(store: Store) -> set[int]:
    with store.read() as connection:
        return set(connection.execute(select(tiles.c.level)).scalars())


def test_certain_segment_ends_at_each_gap_within_a_tile(store: Store) -> None:
    moments = [START + 100 * n for n in range(400)]
    put(
        store,
        *(stretch(n, [1.0] * 30, [2.0] * 30, time=(t, t), dt=1) for n, t in enumerate(moments)),
    )
    build(store)
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        window = Window(START, START + 40_000)
        found = list(find_segments(connection, row, window, Predicate(0.0, None, strict=True)))
    assert [(run.start, run.end) for run in found] == [(t, t + 29) for t in moments]


def test_build_yields_to_other_writers_between_channels(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Chunks of all channels are complete at the same time; other writes must not wait for all."""
    names = [f"t{number:02}.capacitance" for number in range(3)]
    for at, name in enumerate(names):
        moments = [START, START + 20_000]
        put(store, *(stretch(10 * at + n, time=(t, t), dt=1, channel=name)
                     for n, t in enumerate(moments)))  # fmt: skip
    order: list[str] = []

    def write(connection: Connection, place: tuple[str, str], *made: Any) -> None:
        if not order:
            store.write(lambda _: order.append("another"))
        order.append(place[1])
        write_levels(connection, place, *made)

    monkeypatch.setattr("eskin_cloud.rollup.tile_builder.write_levels", write)
    build(store)
    assert order == [names[0], "another", *names[1:]]
    with store.read() as connection:
        assert not connection.execute(select(stale_chunks)).all()
        assert set(connection.execute(select(tiles.c.channel)).scalars()) == set(names)
