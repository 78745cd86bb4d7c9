"""Retention of patches: by the rules of their channels, frames included, tiles follow."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from eskin_cloud.jobs.retention import sweep
from eskin_cloud.rollup.hulls import read_ranges
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.settings import RetentionSection
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.schema.frame_tables import frames, patch_rows, patch_tiles
from eskin_cloud.store.schema.sealed_tables import removals
from eskin_cloud.store.schema.tables import events
from eskin_cloud.store.write.ingest import DUPLICATE
from sqlalchemy import insert, select, update

from eskin.wire.timestamp import SECOND
from tests.unit.cloud.clouds import put, standing
from tests.unit.cloud.messages import NODE, START
from tests.unit.cloud.skins import HAND, PATCHES, describe, frame, statements
from tests.unit.cloud.test_patch_compaction import compact_all, count, require_totals, stored

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation
    from sqlalchemy import Connection

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
DAY = 86_400 * SECOND
RULES = RetentionSection(days=3, channels={"*/tip-*": 10, "*/warm-*": 0}, at_once=40)
"""Page 0 has palm, for 3 days, and warm, forever; page 1 has tip, for 10."""


def bring(stand: Stand, days: range, size: int = 30) -> None:
    """Some frames of each day."""
    for day in days:
        each = [
            frame(100 * day + k, page=k % 2, at=day * DAY + k * SECOND // 10, seed=k)
            for k in range(size)
        ]
        put(stand.cloud.store, *each)


def days_of(stand: Stand) -> dict[str, list[int]]:
    """Of which days there are samples, by patch."""
    found: dict[str, set[int]] = {patch.patch_id: set() for patch in PATCHES}
    for each in stored(stand.cloud.store):
        found[each.patch].add((each.t - START) // DAY)
    return {patch: sorted(of) for patch, of in found.items()}


@pytest.mark.parametrize("compacted", [False, True])
async def test_each_patch_is_kept_as_long_as_its_channels(
    tmp_path: Path, identities: Identities, place: StoreLocation, *, compacted: bool
) -> None:
    with standing(tmp_path, identities, place=place, retention=RULES) as stand:
        store = stand.cloud.store
        describe(store, HAND, *PATCHES)
        bring(stand, range(6))
        if compacted:
            compact_all(store)
        stand.clock.now = START + 5 * DAY + 60 * SECOND
        assert await sweep(stand.cloud) > 0
        assert days_of(stand) == {
            "palm": [3, 4, 5],
            "warm": [0, 1, 2, 3, 4, 5],
            "tip": [0, 1, 2, 3, 4, 5],
        }
        require_totals(store)
        with store.read() as connection:
            query = select(removals.c.place, removals.c.messages)
            assert connection.execute(query).all() == [("palm", 45)]
        assert await sweep(stand.cloud) == 0
        stand.clock.now = START + 15 * DAY
        assert await sweep(stand.cloud) > 0
        assert days_of(stand)["palm"] == []
        assert days_of(stand)["tip"] == [5]
        assert len(days_of(stand)["warm"]) == 6
        require_totals(store)
        copies = put(store, *(frame(100 * 0 + k, page=k % 2, at=k * SECOND // 10, seed=k)
                              for k in range(30)))  # fmt: skip
        assert {each.result for each in copies.results} == {DUPLICATE}


async def test_fresh_frames_stay_frames(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    with standing(tmp_path, identities, place=place, retention=RULES) as stand:
        describe(stand.cloud.store, HAND, *PATCHES)
        bring(stand, range(5))
        stand.clock.now = START + 5 * DAY
        await sweep(stand.cloud)
        with stand.cloud.store.read() as connection:
            left = connection.execute(select(frames.c.page, frames.c.t)).all()
        assert {page for page, _ in left} == {0, 1}
        assert min(t for page, t in left if page == 0) >= START + 2 * DAY


@pytest.mark.parametrize("framed", [True, False])
async def test_events_go_with_their_patch(
    tmp_path: Path, identities: Identities, place: StoreLocation, *, framed: bool
) -> None:
    with standing(tmp_path, identities, place=place, retention=RULES) as stand:
        store = stand.cloud.store
        describe(store, HAND, *PATCHES)
        put(store, *([frame(0)] if framed else []), statements(1))
        with store.read() as connection:
            kinds = connection.execute(select(events.c.kind)).scalars().all()
        assert "peak" in kinds
        stand.clock.now = START + 5 * DAY
        await sweep(stand.cloud)
        with store.read() as connection:
            assert "peak" not in connection.execute(select(events.c.kind)).scalars().all()


@pytest.mark.parametrize(("days", "left"), [(4, ["late"]), (0, ["early", "late"])])
async def test_events_of_a_node_as_a_whole_are_kept_as_long_as_any_channel(
    tmp_path: Path, identities: Identities, place: StoreLocation, days: int, left: list[str]
) -> None:
    rules = RetentionSection(days=3, channels={"*/warm-*": days}, at_once=1)
    with standing(tmp_path, identities, place=place, retention=rules) as stand:
        store = stand.cloud.store
        describe(store, HAND, *PATCHES)
        put(store, frame(0))
        instants = {"early": START, "late": START + 2 * DAY}

        def add(connection: Connection) -> None:
            for number, (detail, t) in enumerate(instants.items()):
                connection.execute(
                    insert(events).values(
                        node=NODE, cursor=1000 + number, boot=1, sequence=1000 + number,
                        kind="contact", t_lo=t, t_hi=t, received=t, detail=detail,
                    )
                )  # fmt: skip

        store.write(add).result()
        stand.clock.now = START + 5 * DAY
        assert await sweep(stand.cloud) > 0
        with store.read() as connection:
            query = select(events.c.detail).where(events.c.kind == "contact")
            found = connection.execute(query.order_by(events.c.t_lo)).scalars().all()
    assert found == left


async def test_tiles_lose_what_is_removed(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    rules = RetentionSection(days=3)
    with standing(tmp_path, identities, place=place, retention=rules) as stand:
        store = stand.cloud.store
        describe(store, HAND, *PATCHES)
        bring(stand, range(5))
        compact_all(store)
        build(store)

        def counted() -> tuple[int, int]:
            with store.read() as connection:
                channel = find_channel(connection, NODE, "palm-0.pressure")
                level = channel["grain"]
                stretch = START - DAY >> level, START + 10 * DAY >> level
                return int(read_ranges(connection, channel, level, [stretch]).n.sum()), level

        assert counted()[0] == 5 * 15 * 5
        before = count(store, patch_tiles)
        stand.clock.now = START + 5 * DAY
        await sweep(stand.cloud)
        assert counted()[0] == 3 * 15 * 5
        build(store)
        assert counted()[0] == 3 * 15 * 5
        assert count(store, patch_tiles) < before
        stand.clock.now = START + 50 * DAY
        await sweep(stand.cloud)
        build(store)
        assert (count(store, patch_tiles), count(store, patch_rows)) == (0, 0)


async def test_damaged_frames_go_when_all_patches_of_the_node_are_too_old(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    rules = RetentionSection(days=3)
    with standing(tmp_path, identities, place=place, retention=rules) as stand:
        store = stand.cloud.store
        describe(store, HAND, *PATCHES)
        bring(stand, range(2))

        def damage(connection: Any) -> None:
            here = frames.c.sequence == 4
            data = bytearray(connection.execute(select(frames.c.data).where(here)).scalar_one())
            data[-3] ^= 1
            connection.execute(update(frames).where(here).values(data=bytes(data)))

        store.write(damage).result(120)
        compact_all(store)
        assert count(store, frames) == 1
        stand.clock.now = START + 5 * DAY
        await sweep(stand.cloud)
        assert count(store, frames) == 0
        require_totals(store)
