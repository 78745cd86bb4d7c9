"""Compaction changes no answer, also with late and removed blocks."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.jobs.compaction import _catch_up, compact
from eskin_cloud.query.export import Export, ExportChannel, ExportPosition
from eskin_cloud.query.predicate import Predicate
from eskin_cloud.query.segments import find_segments
from eskin_cloud.query.series import read_series
from eskin_cloud.rollup.tile_builder import build
from eskin_cloud.settings import LiveSection, PackingSection
from eskin_cloud.store import Store, compaction
from eskin_cloud.store.compaction import compact_page, find_compactable
from eskin_cloud.store.disk_usage import measure_disk
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.removal import RemovalReason, Sweep, remove
from eskin_cloud.store.schema.tables import blocks, metadata
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import delete, select

from eskin.errors import StoreError
from eskin.wire.messages import Block, Encoding
from tests.unit.cloud.clouds import put, standing
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, block

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_cloud.app_state import AppState

    from tests.support.identities import Identities

PLACE = NODE, CHANNEL
SPAN = 100 * DT
"""Of a block of 100 samples."""


def said(number: int, *, late: int = 0, encoding: Encoding = Encoding.Q16) -> Block:
    """The block of so many after the start; ``late`` ones lie elsewhere between the others."""
    random = np.random.default_rng(number)
    lo = np.sin(np.arange(100) / 9 + number) + random.normal(0, 0.02, 100)
    hi = lo + 1.5
    lo[random.random(100) < 0.01] = -np.inf
    begin = START + number * SPAN + late
    time = begin - number, begin + number
    return block(2 * number + bool(late), lo, hi, time=time, encoding=encoding)


def rows(store: Store, *columns: Any) -> list[dict[str, Any]]:
    query = select(*(columns or (blocks,))).order_by(blocks.c.t, blocks.c.boot, blocks.c.sequence)
    with store.read() as connection:
        return [dict(row) for row in connection.execute(query).mappings()]


def pack_all(store: Store, behind: int = 0) -> None:
    for place in find_compactable(store, behind):
        while compact_page(store, place, behind):
            pass


def packs(store: Store) -> list[int]:
    return [row["packed"] for row in rows(store, blocks.c.packed) if row["packed"] is not None]


def exported(store: Store, window: Window, after: ExportPosition | None, limit: int) -> list[bytes]:
    """Blocks page by page, each with an export of its own, as a client that resumes asks."""
    with store.read() as connection:
        channel = find_channel(connection, *PLACE)
    found = []
    while True:
        export = Export([ExportChannel(channel, store.read)], window, after)
        after = export.find_end(limit)
        found += [
            each.encode()
            for part in export.read(after)
            for each in part.blocks
            if isinstance(each, Block)
        ]
        if after is None:
            return found


def answers(store: Store, window: Window) -> list[Any]:
    """The answers for a window."""
    with store.read() as connection:
        channel = find_channel(connection, *PLACE)
        fine = read_series(connection, channel, window, points=20_000)
        coarse = read_series(connection, channel, window, points=7)
        question = Predicate(0.9, None, strict=True)
        segments = [*find_segments(connection, channel, window, question)]
        told = [
            series.t.tolist() + series.lo.tolist() + series.hi.tolist() for series in (fine, coarse)
        ]
        sums = [channel[name] for name in ("blocks", "samples", "t_first", "t_last", "lo", "hi")]
    return [*told, segments, sums, fine.coverage, coarse.coverage]


@pytest.mark.parametrize(
    "time",
    [(2**62 + 10**12,) * 2, (-(2**62) - 10**12,) * 2, (-(2**62) - 5, 2**62 + 8)],
    ids=["late", "early", "unknown"],
)
def test_packs_far_from_1970_equal_their_blocks(store: Store, time: tuple[int, int]) -> None:
    random = np.random.default_rng(1)
    lo = random.normal(size=(22, 100))
    times = [(time[0] + k * SPAN, time[1] + k * SPAN) for k in range(22)]
    put(store, *[
        block(k, lo[k], lo[k] + 1, time=times[k], encoding=Encoding.Q16) for k in range(22)
    ])  # fmt: skip
    middle = sum(time) // 2
    windows = [
        Window(middle - SPAN, middle + 20 * SPAN),
        Window(middle + 50, middle + 5 * SPAN + 7),
    ]
    told = [answers(store, window) for window in windows]
    assert len(told[0][0]) == 3 * 2000
    pack_all(store)
    assert packs(store) == [21]
    assert [answers(store, window) for window in windows] == told


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("more"), st.integers(1, 30)),
        st.tuples(st.just("late"), st.integers(0, 40)),
        st.tuples(st.just("pack"), st.sampled_from([0, 0, 5])),
        st.tuples(st.just("remove"), st.integers(0, 3000)),
        st.tuples(st.just("build"), st.just(0)),
    ),
    min_size=3,
    max_size=8,
)


class Twins:
    """Two stores with the same messages; one of them never compacts."""

    def __init__(self, store: Store, plain: Store) -> None:
        self.store, self.plain = store, plain
        self.next = 0
        for each in (store, plain):
            each.write(_clear).result(120)
            each.cache.clear()

    def take(self, step: str, number: int) -> None:
        """Do one step."""
        if step == "pack":
            pack_all(self.store, number)
            return
        for each in (self.store, self.plain):
            if step == "more":
                numbers = range(self.next, self.next + number)
                put(each, *(said(k, encoding=_kind(k)) for k in numbers))
            elif step == "late":
                put(each, said(number, late=37 * DT + 11))
            elif step == "remove":
                _remove(each, START + number * DT)
            else:
                build(each)
        self.next += number if step == "more" else 0

    def compare(self) -> None:
        """Ask both the same; finds nothing."""
        whole = Window(START - SPAN, START + 200 * SPAN)
        if not rows(self.plain):
            assert not rows(self.store)
            return
        for window in (whole, Window(START + 3 * SPAN + 5, START + 23 * SPAN + 7)):
            assert answers(self.store, window) == answers(self.plain, window)
            raw = exported(self.plain, window, None, 10**9)
            assert exported(self.store, window, None, 10**9) == raw
            assert exported(self.store, window, None, 950) == raw


def _kind(number: int) -> Encoding:
    return Encoding.F32 if number % 17 == 16 else Encoding.Q16


def _clear(connection: Any) -> None:
    for table in metadata.sorted_tables:
        if table.name not in {"versions", "feed", "audit_log"}:
            connection.execute(delete(table))


def _remove(store: Store, before: int) -> None:
    sweep = Sweep(*PLACE, RemovalReason.AGE, before)
    while (
        store.write(lambda c: remove(c, store.cache, sweep, most=7, now=store.clock())).result(120)
        >= 7
    ):
        pass


@pytest.fixture
def plain(tmp_path: Path) -> Iterator[Store]:
    """A store without compaction."""
    with Store(tmp_path / "plain.sqlite") as opened:
        yield opened


@settings(
    max_examples=5, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(steps=STEPS)
def test_compaction_changes_no_answer(
    store: Store, plain: Store, monkeypatch: pytest.MonkeyPatch, steps: list[tuple[str, int]]
) -> None:
    monkeypatch.setattr("eskin_cloud.rollup.blocks._FEW", 8)  # else all are decoded
    twins = Twins(store, plain)
    twins.take("more", 45)
    twins.take("pack", 0)
    for step, number in steps:
        twins.take(step, number)
    twins.compare()
    twins.take("pack", 0)
    twins.compare()


def test_pack_holds_consecutive_blocks_only(store: Store) -> None:
    put(store, *(said(k, encoding=_kind(k)) for k in range(70)))
    before = rows(store)
    pack_all(store)
    assert packs(store) == [16, 16, 16, 16]
    left = [row for row in rows(store) if row["packed"] is None]
    assert [row["sequence"] // 2 for row in left] == [16, 33, 50, 67, 68, 69]
    assert all(row in before for row in left)


def test_disk_use_counts_samples_and_free_bytes(store: Store) -> None:
    put(store, *map(said, range(210)))
    before = measure_disk(store)
    assert (before.samples, before.taken > 0) == (21_000, True)
    pack_all(store)
    after = measure_disk(store)
    assert after.samples == 21_000
    if isinstance(store.location, Path):
        assert after.free > before.free


def test_blocks_in_the_feed_backlog_are_not_compacted(store: Store) -> None:
    put(store, *map(said, range(60)))
    pack_all(store, 60)
    assert packs(store) == []
    pack_all(store, 20)
    assert sum(packs(store)) == 21


def test_pack_of_a_removed_block_is_not_written(store: Store, monkeypatch: Any) -> None:
    put(store, *map(said, range(30)))
    keep = compaction._replace

    def lose_one(connection: Any, *rest: Any) -> bool:
        connection.execute(delete(blocks).where(blocks.c.sequence == 4))
        return keep(connection, *rest)

    monkeypatch.setattr(compaction, "_replace", lose_one)
    assert not compact_page(store, PLACE, 0)
    assert packs(store) == []
    assert len(rows(store)) == 29


def test_fault_in_the_middle_leaves_every_block_once(store: Store, monkeypatch: Any) -> None:
    put(store, *map(said, range(30)))
    before = rows(store)

    def fail(*_: Any) -> None:
        raise StoreError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(compaction, "insert_many", fail)
        with pytest.raises(StoreError, match="disk is full"):
            compact_page(store, PLACE, 0)
    assert rows(store) == before
    pack_all(store)
    assert sum(packs(store)) == 21


@pytest.mark.anyio
async def test_background_compaction_follows_its_setting(
    tmp_path: Path, identities: Identities, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def once(cloud: AppState, stopping: asyncio.Event) -> None:
        await _catch_up(cloud, stopping)
        stopping.set()

    monkeypatch.setattr("eskin_cloud.jobs.compaction._catch_up", once)
    for on in (False, True):
        folder = tmp_path / str(on)
        folder.mkdir()
        section, live = PackingSection(on=on), LiveSection(backlog=2)
        with standing(folder, identities, packing=section, live=live) as stand:
            put(stand.cloud.store, *map(said, range(45)))
            await compact(stand.cloud, asyncio.Event())
            # A stream at the edge of the backlog reads on while others store: the last four stay.
            assert packs(stand.cloud.store) == [21] * on
