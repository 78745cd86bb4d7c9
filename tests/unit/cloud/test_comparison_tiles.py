"""Comparisons of two channels answered from tiles and from blocks' bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_cloud.query.comparison import find_comparison_segments
from eskin_cloud.query.comparison_segments import merge, total_comparison
from eskin_cloud.query.neighbourhood import ChannelSource, Neighbourhood
from eskin_cloud.rollup.tile_builder import build
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window

from eskin.interval import Verdict
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch
from tests.unit.cloud.test_comparison import OTHER, ask
from tests.unit.cloud.test_queries import spy_on_decoding

if TYPE_CHECKING:
    from eskin_cloud.query.comparison_segments import ComparisonSegment
    from eskin_cloud.store import Store
    from eskin_cloud.store.read.lookup import Channel

    from eskin.wire.frames import Frame


def long_blocks(random: np.random.Generator, channel: str, *, level: float) -> list[Frame]:
    """Many blocks of a level that crosses the other's now and then, with gaps and overlaps."""
    made, first = [], START + int(random.integers(0, 50))
    for sequence in range(400):
        n = int(random.integers(50, 200))
        dt = int(random.choice([10, 10, 10, 25]))
        base = level + (3.0 if random.random() < 0.02 else 0.0)
        lo = base + random.random(n) * 0.5
        error = int(random.choice([0, 3, 3, 200, 100_000], p=[0.4, 0.3, 0.25, 0.04, 0.01]))
        time = first - error, first + error
        number = 2 * sequence + (channel == OTHER)
        made.append(stretch(number, lo, lo + 0.4, time=time, dt=dt, channel=channel))
        first += n * dt + (int(random.choice([0, 0, 4, 15, 60_000, -40])) if n % 5 == 0 else 0)
    return made


def told(stretches: list[ComparisonSegment]) -> list[tuple[int, int, Verdict | None]]:
    return [(s.start, s.end, s.answer) for s in stretches]


def without_tiles(row: Channel) -> Channel:
    return {**row, "grain": None}


def ask_blocks(store: Store, window: Window) -> list[ComparisonSegment]:
    """As `ask`, of a few blocks each time."""
    with store.read() as connection:
        sides = [
            ChannelSource(connection, without_tiles(find_channel(connection, NODE, channel)))
            for channel in (CHANNEL, OTHER)
        ]
        return list(find_comparison_segments(sides[0], sides[1], window))


@pytest.mark.parametrize("seed", range(2))
def test_tiles_answer_as_blocks_despite_late_ones(store: Store, seed: int) -> None:
    random = np.random.default_rng(seed)
    said = [long_blocks(random, CHANNEL, level=1.0), long_blocks(random, OTHER, level=2.0)]
    # Late ones spoil tiles at one end alone.
    late = [blocks.pop(int(random.integers(330, 390))) for blocks in said for _ in range(3)]
    put(store, *said[0], *said[1])
    build(store)
    put(store, *late)
    for _ in range(5):
        start = START + int(random.integers(-1000, 500_000))
        window = Window(start, start + int(random.integers(1, 700_000)))
        tiled = ask(store, window)
        middle = (window.start + window.end) // 2
        cuts = Window(window.start, middle), Window(middle, window.end)
        parts = list(merge(part for cut in cuts for part in ask_blocks(store, cut)))
        assert told(tiled) == told(parts)
        whole, apart = total_comparison(tiled), total_comparison(parts)
        assert (whole.time, whole.unknown) == (apart.time, apart.unknown)
        assert whole.entries == apart.entries


def flat(channel: str, level: float, count: int, *, first: int = START) -> list[Frame]:
    """Blocks of ten samples that follow each other."""
    odd = channel == OTHER
    return [
        stretch(2 * k + odd, [level] * 10, [level + 1] * 10, time=(t, t), dt=10, channel=channel)
        for k, t in enumerate(range(first, first + 100 * count, 100))
    ]


def test_only_undecided_blocks_are_decoded(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    said = flat(CHANNEL, 5.0, 9)
    said[4] = stretch(8, [5.0] * 5 + [1.5] * 5, [6.0] * 10, time=(START + 400,) * 2, dt=10)
    put(store, *said, *flat(OTHER, 1.0, 9, first=START + 5))
    decoded = spy_on_decoding(monkeypatch)
    found = ask(store, Window(START, START + 1000))
    assert sorted(b.position.sequence for b in decoded) == [7, 8, 9]
    assert [(s.start - START, s.end - START, s.answer) for s in found] == [
        (0, 5, None),
        (5, 450, Verdict.CERTAIN),
        (450, 500, Verdict.POSSIBLE),
        (500, 900, Verdict.CERTAIN),
        (900, 1000, None),
    ]


def test_decided_tiles_read_no_block(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    put(store, *flat(CHANNEL, 5.0, 5000), *flat(OTHER, 1.0, 5000))
    build(store)
    asked: list[Window] = []

    def look(source: ChannelSource, window: Window) -> Neighbourhood:
        asked.append(window)
        return Neighbourhood(source, window)

    monkeypatch.setattr("eskin_cloud.query.comparison.look_around", look)
    decoded = spy_on_decoding(monkeypatch)
    found = ask(store, Window(START - 500_000, START + 800_000))
    assert told(found) == [
        (START - 500_000, START, None),
        (START, START + 500_000, Verdict.CERTAIN),
        (START + 500_000, START + 800_000, None),
    ]
    assert decoded == []
    near = [w for w in asked if w.start < START + 190_000 and w.end > START + 40_000]
    assert near == []
