"""Channels whose rate changes much: tiles of a length that fits, and answers as ever."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_cloud.query.export import Export, ExportChannel
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window

from tests.unit.cloud.brute_force import (
    BOUNDS,
    QUESTIONS,
    Truth,
    ask,
    check_states,
    compact_all,
    compare,
    count_marked,
    lowest_level,
)
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch

if TYPE_CHECKING:
    from eskin_cloud.store import Store


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("seed", "frames"),
    [(0, 4), *(pytest.param(seed, 7, marks=pytest.mark.nightly) for seed in range(2))],
)
def test_rates_far_apart_need_few_chunks(store: Store, seed: int, frames: int) -> None:
    random = np.random.default_rng(seed)
    said = [stretch(0, [0.1], [0.3], time=(START, START), dt=1)]
    put(store, *said)
    compact_all(store)
    grains = [lowest_level(store)]
    for number in range(1, frames + 1):
        dt = int(random.choice([1, 900, 10**6, 10**9, 10**12]))
        n = int(random.choice([1, 5, 300, 1000]))
        sides = np.sort(random.choice(BOUNDS[1:-2], (2, n)), axis=0)
        begin = START + int(random.integers(0, 10 ** int(random.integers(3, 15))))
        said.append(stretch(number, *sides, time=(begin, begin), dt=dt))
        put(store, said[-1])
        compact_all(store)
        if random.random() < 0.7:
            build(store)
        grains.append(lowest_level(store))
        truth = Truth(said)
        first, last = np.sort(random.choice(truth.t, 2)).tolist()
        window = Window(first, last + 1 + int(random.integers(10**6)))
        check_states(store, truth, window, QUESTIONS[int(random.integers(len(QUESTIONS)))])
        series = ask(store, window, 100)
        if series.resolution == "hull":
            compare(series, truth, window, 100)
    build(store)
    assert count_marked(store) == 0
    assert grains == sorted(grains)


def test_rate_a_thousand_times_lower_keeps_the_tiles(store: Store) -> None:
    values = np.zeros(250), np.ones(250)
    put(store, stretch(0, *values, time=(START, START), dt=1_000_000))
    compact_all(store)
    grain = lowest_level(store)
    put(store, stretch(1, *values, time=(START + 10**9,) * 2, dt=1_000_000_000))
    compact_all(store)
    build(store)
    put(store, stretch(2, *values, time=(START + 2 * 10**9,) * 2, dt=1_000_000_000))
    compact_all(store)
    assert count_marked(store) > 0, "the second one is late"
    assert lowest_level(store) == grain


@pytest.mark.nightly
def test_channel_at_the_beginning_of_time_is_built_and_exported(store: Store) -> None:
    first, ms = -(2**63) + 1, 10**6
    fast = [
        stretch(k, np.zeros(1000), np.ones(1000), time=(first + k * ms, first + k * ms), dt=1000)
        for k in range(40)
    ]
    slow = stretch(40, [0.0, 0.0], [2.0, 3.0], time=(first, first), dt=10**12)
    later = stretch(41, [0.0], [4.0], time=(first + 3 * 10**12,) * 2, dt=1000)
    for said in ([*fast, slow], [later]):
        put(store, *said)
        compact_all(store)
        build(store)
    window = Window(first, first + 4 * 10**12)
    compare(ask(store, window, 7), Truth([*fast, slow, later]), window, 7)
    with store.read() as connection:
        sources = [ExportChannel(find_channel(connection, NODE, CHANNEL), store.read)]
    mark = Export(sources, window, None).find_end(1)
    rest = [b for part in Export(sources, window, mark).read(None) for b in part.runs]
    assert len(rest) == 41
