"""A few slow frames among fast ones: exact answers, and tiles that stay as short as they were."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import (
    MOST_CHUNKS,
    MOST_SPAN,
    TOP,
    SampleGrid,
    base_level,
    level_for,
)

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
from tests.unit.cloud.messages import START, stretch

if TYPE_CHECKING:
    from eskin_cloud.store import Store

    from eskin.wire.frames import Frame

MS, SLOWEST = 10**6, 10**12
"""A usual period, and the longest one that the wire contract knows."""


def drawn(random: np.random.Generator, sequence: int) -> Frame:
    """A frame of a fast or of a slow part, anywhere in some hours."""
    dt = int(random.choice([MS, 10**9, 10**11, SLOWEST]))
    n = int(random.integers(1, MOST_CHUNKS + 1 if dt > MS else 1000))
    sides = np.sort(random.choice(BOUNDS[1:-1], (2, n)), axis=0)
    begin = START + int(random.integers(0, 10**13))
    return stretch(sequence, *sides, time=(begin, begin + int(random.integers(0, 5))), dt=dt)


@pytest.mark.parametrize("seed", range(3))
def test_slow_frames_among_fast_ones_equal_brute_force(store: Store, seed: int) -> None:
    random = np.random.default_rng(seed)
    said = [stretch(0, [0.1], [0.3], time=(START, START), dt=MS)]
    put(store, *said)
    for step in range(4):
        fresh = [drawn(random, 10 * step + k) for k in range(1, random.integers(3, 9))]
        said += fresh
        put(store, *fresh[:2])
        build(store)
        compact_all(store)
        put(store, *fresh[2:])
        compact_all(store)
        assert count_marked(store) <= MOST_CHUNKS * len(fresh)
        if random.random() < 0.7:
            build(store)
        assert lowest_level(store) == base_level(MS)
        truth = Truth(said)
        for _ in range(3):
            first, last = np.sort(random.choice(truth.t, 2)).tolist()
            window = Window(first, last + 1 + int(random.integers(MS)))
            check_states(store, truth, window, QUESTIONS[int(random.integers(len(QUESTIONS)))])
            series = ask(store, window, 100)
            if series.resolution == "hull":
                compare(series, truth, window, 100)


@pytest.mark.parametrize("dt", [1, MS, 10**9, SLOWEST])
@pytest.mark.parametrize("n", [1, 2, MOST_CHUNKS, MOST_CHUNKS + 1, 1000])
@pytest.mark.parametrize("first", [1, MS])
def test_a_level_is_as_low_as_its_bounds_allow(first: int, n: int, dt: int) -> None:
    samples, own = SampleGrid(START, dt, n), base_level(first)
    grain = level_for(own, samples)
    for level in range(own, min(grain, TOP - 2) + 1, 2):
        chunks = {(START + k * dt) >> (level + 8) for k in range(n)}
        assert sorted(samples.chunks(level)) == sorted(chunks)
        span = max(chunks) - min(chunks) + 1
        # The first one keeps what it has, if it can.
        assert (level == grain) == (len(chunks) <= MOST_CHUNKS and span <= MOST_SPAN)
