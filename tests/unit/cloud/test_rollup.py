"""Rollups against brute force, while frames arrive in any order and are compacted."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_cloud.jobs.overview_tiles import build_rollup
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.schema.frame_tables import patch_tiles
from sqlalchemy import select

from eskin.interval import Verdict
from eskin.monitor import parse
from tests.unit.cloud.brute_force import (
    BOUNDS,
    QUESTIONS,
    Truth,
    ask,
    check_states,
    compact_all,
    compare,
    lowest_level,
    verdicts_of,
)
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch

if TYPE_CHECKING:
    from eskin_cloud.store import Store

    from eskin.wire.frames import Frame
    from tests.unit.cloud.clouds import Stand

SPAN = 2_000_000
"""Of all frames, in ns."""


def drawn(random: np.random.Generator, sequence: int, first: int, last: int) -> Frame:
    """A frame somewhere in a stretch of time, of a node that starts anew now and then."""
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


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.nightly)])
def test_buckets_equal_brute_force(store: Store, seed: int) -> None:
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
                compact_all(store)
            if random.random() < 0.5:
                build(store)
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


@pytest.mark.anyio
async def test_background_build_starts_and_stops(stand: Stand) -> None:
    instants = [START + n * 20_000 for n in range(5)]
    put(stand.cloud.store, *(stretch(n, time=(t, t), dt=1) for n, t in enumerate(instants)))
    compact_all(stand.cloud.store)
    stopping = asyncio.Event()
    building = asyncio.create_task(build_rollup(stand.cloud, stopping))
    while not _levels(stand.cloud.store):  # noqa: ASYNC110 - made by the code under test
        await asyncio.sleep(0.01)
    stopping.set()
    await building
    assert min(_levels(stand.cloud.store)) == lowest_level(stand.cloud.store)


def _levels(store: Store) -> set[int]:
    with store.read() as connection:
        return set(connection.execute(select(patch_tiles.c.level)).scalars())


def test_certain_stretch_ends_at_each_gap_within_a_tile(store: Store) -> None:
    instants = [START + 100 * n for n in range(400)]
    put(
        store,
        *(stretch(n, [1.0] * 30, [2.0] * 30, time=(t, t), dt=1) for n, t in enumerate(instants)),
    )
    compact_all(store)
    build(store)
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        found = verdicts_of(connection, row, Window(START, START + 39_930), parse("x > 0"))
    certain = [(each.first, each.last + 1) for each in found if each.verdict is Verdict.CERTAIN]
    assert certain == [(2 * t, 2 * (t + 30)) for t in instants[:-1]] + [
        (2 * instants[-1], 2 * instants[-1] + 59)
    ]
    assert all(each.missing for each in found if each.verdict is not Verdict.CERTAIN)
