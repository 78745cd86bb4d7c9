"""Comparisons of two channels answered from tiles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.query.comparison import find_comparison_segments
from eskin_cloud.query.comparison_segments import merge, total_comparison
from eskin_cloud.query.neighbourhood import ChannelSource, look_around
from eskin_cloud.query.predicate import Predicate
from eskin_cloud.query.segments import find_segments
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store.patch_rows import decode_column
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.schema.frame_tables import patch_rows
from sqlalchemy import func, select

from eskin.interval import Verdict
from eskin.wire.timestamp import SECOND
from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch
from tests.unit.cloud.test_comparison import OTHER, ask

if TYPE_CHECKING:
    from eskin_cloud.query.comparison_segments import ComparisonSegment
    from eskin_cloud.query.sample_validity import SampleValidity
    from eskin_cloud.store import Store
    from eskin_cloud.store.read.lookup import Channel

    from eskin.wire.frames import Frame


def long_frames(random: np.random.Generator, channel: str, *, level: float) -> list[Frame]:
    """Many frames of a level that crosses the other's now and then, with gaps and overlaps."""
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


def stated(stretches: list[ComparisonSegment]) -> list[tuple[int, int, Verdict | None]]:
    return [(s.start, s.end, s.answer) for s in stretches]


def without_tiles(row: Channel) -> Channel:
    return {**row, "grain": None}


def ask_samples(store: Store, window: Window) -> list[ComparisonSegment]:
    """As `ask`, without tiles."""
    with store.read() as connection:
        sides = [
            ChannelSource(connection, without_tiles(find_channel(connection, NODE, channel)))
            for channel in (CHANNEL, OTHER)
        ]
        return list(find_comparison_segments(sides[0], sides[1], window))


@pytest.mark.parametrize("seed", [1, pytest.param(0, marks=pytest.mark.nightly)])
def test_tiles_answer_as_samples_despite_late_ones(store: Store, seed: int) -> None:
    random = np.random.default_rng(seed)
    said = [long_frames(random, CHANNEL, level=1.0), long_frames(random, OTHER, level=2.0)]
    # Late ones spoil tiles at one end alone.
    late = [frames.pop(int(random.integers(330, 390))) for frames in said for _ in range(3)]
    put(store, *said[0], *said[1])
    compact_all(store)
    build(store)
    put(store, *late)
    for _ in range(5):
        start = START + int(random.integers(-1000, 500_000))
        window = Window(start, start + int(random.integers(1, 700_000)))
        tiled = ask(store, window)
        middle = (window.start + window.end) // 2
        cuts = Window(window.start, middle), Window(middle, window.end)
        parts = list(merge(part for cut in cuts for part in ask_samples(store, cut)))
        assert stated(tiled) == stated(parts)
        whole, apart = total_comparison(tiled), total_comparison(parts)
        assert (whole.time, whole.unknown) == (apart.time, apart.unknown)
        assert whole.entries == apart.entries


def flat(channel: str, level: float, count: int, *, first: int = START) -> list[Frame]:
    """Frames of ten samples that follow each other."""
    odd = channel == OTHER
    return [
        stretch(2 * k + odd, [level] * 10, [level + 1] * 10, time=(t, t), dt=10, channel=channel)
        for k, t in enumerate(range(first, first + 100 * count, 100))
    ]


def test_decided_tiles_read_no_sample(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    put(store, *flat(CHANNEL, 5.0, 5000), *flat(OTHER, 1.0, 5000))
    compact_all(store)
    build(store)
    asked: list[Window] = []

    def look(source: ChannelSource, window: Window) -> SampleValidity:
        asked.append(window)
        return look_around(source, window)

    monkeypatch.setattr("eskin_cloud.query.comparison.look_around", look)
    found = ask(store, Window(START - 500_000, START + 800_000))
    assert stated(found) == [
        (START - 500_000, START, None),
        (START, START + 500_000, Verdict.CERTAIN),
        (START + 500_000, START + 800_000, None),
    ]
    near = [w for w in asked if w.start < START + 190_000 and w.end > START + 40_000]
    assert near == []


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """The compacted rows that are decoded."""
    found: list[bytes] = []

    def look(data: bytes, *rest: Any) -> Any:
        found.append(data)
        return decode_column(data, *rest)

    monkeypatch.setattr("eskin_cloud.store.read.patch_columns.decode_column", look)
    return found


def hump() -> list[Frame]:
    """Frames of 10 s each; number 500 of 1000 is higher than all others."""
    dt = SECOND // 10
    return [
        stretch(k, [level] * 100, [level + 0.5] * 100, time=(t, t), dt=dt)
        for k, t in enumerate(range(START, START + 100_000 * dt, 100 * dt))
        for level in [5.0 if k == 500 else 1.0]
    ]


def test_only_undecided_rows_are_decoded(store: Store, decoded: list[bytes]) -> None:
    put(store, *hump())
    compact_all(store)
    build(store)
    window = Window(START, START + 9000 * SECOND)  # the last rows are not in tiles yet
    with store.read() as connection:
        rows = connection.execute(select(func.count()).select_from(patch_rows)).scalar_one()
        channel = find_channel(connection, NODE, CHANNEL)
        decoded.clear()
        (found,) = find_segments(connection, channel, window, Predicate(3.0, None, strict=True))
    assert (found.start, found.n, found.answer) == (START + 5000 * SECOND, 100, Verdict.CERTAIN)
    assert rows >= 15
    assert 0 < len(set(decoded)) <= 4  # one at each end, too: they share a tile with others
