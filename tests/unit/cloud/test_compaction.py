"""Compaction changes no answer, wherever the frames lie in time, and follows its settings."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.jobs.compaction import _catch_up, compact
from eskin_cloud.query.export import Export, ExportChannel, ExportPosition
from eskin_cloud.query.series import read_series
from eskin_cloud.settings import CompactionSection
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.schema.frame_tables import patch_rows
from sqlalchemy import func, select

from eskin.monitor import parse
from eskin.monitor.signal import MAX_INSTANT
from tests.unit.cloud.brute_force import compact_all, verdicts_of
from tests.unit.cloud.clouds import put, standing
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_cloud.app_state import AppState
    from eskin_cloud.store import Store

    from eskin.wire.frames import Frame
    from tests.support.identities import Identities

SPAN = 100 * DT
"""Of a frame of 100 samples."""


def said(number: int, time: tuple[int, int] = (START, START)) -> Frame:
    """The frame of so many after an instant."""
    random = np.random.default_rng(number)
    lo = np.sin(np.arange(100) / 9 + number) + random.normal(0, 0.02, 100)
    hi = lo + 1.5
    lo[random.random(100) < 0.01] = -np.inf
    first, last = (instant + number * SPAN for instant in time)
    return stretch(number, lo, hi, time=(first, last))


def exported(store: Store, window: Window, limit: int) -> list[tuple[Any, ...]]:
    """All samples, page by page, each with an export of its own, as a client that resumes asks."""
    with store.read() as connection:
        channel = find_channel(connection, NODE, CHANNEL)
    after: ExportPosition | None = None
    found: list[tuple[Any, ...]] = []
    while True:
        export = Export([ExportChannel(channel, store.read)], window, after)
        after = export.find_end(limit)
        found += [
            (*run[:-2], run.lo.tolist(), run.hi.tolist())
            for part in export.read(after)
            for run in part.runs
        ]
        if after is None:
            return found


def answers(store: Store, window: Window) -> list[Any]:
    """The answers for a window."""
    with store.read() as connection:
        channel = find_channel(connection, NODE, CHANNEL)
        fine = read_series(connection, channel, window, points=20_000)
        coarse = read_series(connection, channel, window, points=7)
        verdicts = (
            verdicts_of(connection, channel, window, parse(f"{CHANNEL} > 0.9"))
            if max(-window.start, window.end) < MAX_INSTANT
            else None
        )
    stated = [
        series.t.tolist() + series.lo.tolist() + series.hi.tolist() for series in (fine, coarse)
    ]
    raw = exported(store, window, 10**9)
    assert exported(store, window, 950) == raw
    return [*stated, verdicts, fine.coverage, coarse.coverage, raw]


@pytest.mark.parametrize(
    "time",
    [
        (START,) * 2,
        (2**62 + 10**12,) * 2,
        (-(2**62) - 10**12,) * 2,
        (-(2**62) - 5, 2**62 + 8),
    ],
    ids=["now", "late", "early", "unknown"],
)
def test_rows_equal_their_frames_however_far_from_1970(store: Store, time: tuple[int, int]) -> None:
    frames = [said(number, time) for number in range(22)]
    put(store, *frames)
    middle = sum(time) // 2
    windows = [
        Window(middle - SPAN, middle + 20 * SPAN),
        Window(middle + 50, middle + 5 * SPAN + 7),
    ]
    stated = [answers(store, window) for window in windows]
    assert len(stated[0][0]) == 3 * 2000
    compact_all(store)
    assert count_rows(store) == 1
    assert [answers(store, window) for window in windows] == stated


def count_rows(store: Store) -> int:
    with store.read() as connection:
        return int(connection.execute(select(func.count()).select_from(patch_rows)).scalar_one())


@pytest.mark.anyio
async def test_background_compaction_follows_its_settings(
    tmp_path: Path, identities: Identities, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def once(cloud: AppState, stopping: asyncio.Event) -> None:
        await _catch_up(cloud, stopping)
        stopping.set()

    monkeypatch.setattr("eskin_cloud.jobs.compaction._catch_up", once)
    for on, minutes, rows in ((False, 61.0, 0), (True, 61.0, 1), (True, 63.0, 0)):
        folder = tmp_path / f"{on}-{minutes}"
        folder.mkdir()
        section = CompactionSection(on=on, after_min=minutes)
        with standing(folder, identities, compaction=section) as stand:
            put(stand.cloud.store, *map(said, range(45)))
            stand.clock.turn(62 * 60.0)  # so old they are
            await compact(stand.cloud, asyncio.Event())
            assert count_rows(stand.cloud.store) == rows
