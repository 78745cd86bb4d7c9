"""What the store takes of the disk, for each sample."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_cloud.store.compaction import compact_page
from eskin_cloud.store.removal import RemovalReason, Sweep, remove
from eskin_cloud.store.schema.tables import blocks
from sqlalchemy import func, select

from eskin.wire.messages import Encoding
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch

if TYPE_CHECKING:
    from eskin_cloud.store import Store

    from eskin.wire.messages import Block
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
OTHER = "t02.capacitance"
SAMPLES = 100


def said(number: int, channel: str = CHANNEL) -> Block:
    start = START + number * SAMPLES * DT
    sequence = 2 * number + (channel == OTHER)
    values = [1.0 + number] * SAMPLES, [2.0 + number] * SAMPLES
    time = start, start
    return stretch(sequence, *values, channel=channel, time=time, encoding=Encoding.Q16)


async def told(stand: Stand) -> dict[str, int]:
    items = (await stand.get(f"/api/v1/nodes/{NODE}/channels")).json()["items"]
    return {item["id"]: item["bytes"] for item in items if item["blocks"] > 0}


def counted(stand: Stand) -> dict[str, int]:
    query = select(blocks.c.channel, func.sum(func.length(blocks.c.data)))
    with stand.cloud.store.read() as connection:
        return {row[0]: int(row[1]) for row in connection.execute(query.group_by("channel"))}


def shorten(store: Store, sweep: Sweep) -> None:
    store.write(lambda c: remove(c, store.cache, sweep, most=1000, now=store.clock())).result(120)


async def test_bytes_a_sample_are_all_bytes_by_all_samples(stand: Stand) -> None:
    empty = (await stand.get("/api/v1/storage")).json()
    assert empty["samples"] == 0
    assert empty["bytes_per_sample"] is None
    put(stand.cloud.store, *(stretch(k, [1.0] * 500, [2.0] * 500) for k in range(20)))
    found = (await stand.get("/api/v1/storage")).json()
    assert found["samples"] == 10_000
    # Of each sample two floats of 64 bit are kept, whatever else is.
    assert found["bytes"] - found["free_bytes"] > 160_000
    each = (found["bytes"] - found["free_bytes"]) / 10_000
    assert found["bytes_per_sample"] == pytest.approx(each)
    told = f"eskin_cloud_store_bytes_per_sample {found['bytes_per_sample']}"
    assert told in stand.cloud.metrics.write().decode()


async def test_channel_tells_what_its_blocks_take_also_packed_and_in_part_removed(
    stand: Stand,
) -> None:
    store = stand.cloud.store
    put(store, *(said(k) for k in range(64)), *(said(k, OTHER) for k in range(3)))
    came = await told(stand)
    assert came == counted(stand)
    assert came[CHANNEL] > came[OTHER] > 0
    compact_page(store, (NODE, CHANNEL), behind=0)
    packed = await told(stand)
    assert packed == counted(stand)
    assert packed[CHANNEL] < came[CHANNEL]
    assert packed[OTHER] == came[OTHER]
    for kept in (50, 10):
        before = START + (64 - kept) * SAMPLES * DT
        shorten(store, Sweep(NODE, CHANNEL, RemovalReason.AGE, before))
        assert await told(stand) == counted(stand)
