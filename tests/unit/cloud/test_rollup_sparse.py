"""A few slow frames among fast ones: exact answers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store.read.window import Window

from tests.unit.cloud.brute_force import (
    BOUNDS,
    QUESTIONS,
    Truth,
    ask,
    check_states,
    compact_all,
    compare,
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
    n = int(random.integers(1, 65 if dt > MS else 1000))
    sides = np.sort(random.choice(BOUNDS[1:-2], (2, n)), axis=0)
    begin = START + int(random.integers(0, 10**13))
    return stretch(sequence, *sides, time=(begin, begin + int(random.integers(0, 5))), dt=dt)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("seed", "steps"),
    [(0, 2), *(pytest.param(seed, 4, marks=pytest.mark.nightly) for seed in range(3))],
)
def test_slow_frames_among_fast_ones_equal_brute_force(store: Store, seed: int, steps: int) -> None:
    random = np.random.default_rng(seed)
    said = [stretch(0, [0.1], [0.3], time=(START, START), dt=MS)]
    put(store, *said)
    for step in range(steps):
        fresh = [drawn(random, 10 * step + k) for k in range(1, random.integers(3, 9))]
        said += fresh
        put(store, *fresh[:2])
        build(store)
        compact_all(store)
        put(store, *fresh[2:])
        compact_all(store)
        if random.random() < 0.7:
            build(store)
        truth = Truth(said)
        for _ in range(3):
            first, last = np.sort(random.choice(truth.t, 2)).tolist()
            window = Window(first, last + 1 + int(random.integers(MS)))
            check_states(store, truth, window, QUESTIONS[int(random.integers(len(QUESTIONS)))])
            series = ask(store, window, 100)
            if series.resolution == "hull":
                compare(series, truth, window, 100)
