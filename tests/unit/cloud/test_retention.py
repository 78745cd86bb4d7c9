"""Retention: in steps, and by the first rule that fits a channel."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import pytest
from eskin_cloud.jobs.retention import apply_retention, kept_for
from eskin_cloud.settings import RetentionSection
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.schema.sealed_tables import sealed_messages
from sqlalchemy import select

from eskin.wire.timestamp import SECOND
from tests.unit.cloud.clouds import Stand, batch
from tests.unit.cloud.messages import START, stretch
from tests.unit.cloud.sealing import Site, pulse, sealing

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from tests.support.identities import Identities

pytestmark = pytest.mark.anyio
DAY = 86_400


def rows(stand: Stand, table: Any) -> list[dict[str, Any]]:
    with stand.cloud.store.read() as connection:
        return [dict(row) for row in connection.execute(select(table)).mappings()]


def at_day(stand: Stand, number: float) -> None:
    stand.clock.now = START + int(number * DAY * SECOND)


async def test_ingest_goes_on_between_the_steps(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    site = Site(tmp_path)
    rules = RetentionSection(days=1, biometric_days=1, at_once=10, every_s=0.05)
    with sealing(tmp_path, identities, place=place, retention=rules) as stand:
        at_day(stand, 0)
        await stand.ingest(site.batch(*map(pulse, range(200))))
        at_day(stand, 3)
        stopping = asyncio.Event()
        before = stand.cloud.store.jobs
        running = asyncio.create_task(apply_retention(stand.cloud, stopping))
        instant = START + 3 * DAY * SECOND
        answer = await stand.ingest(batch(stretch(1, time=(instant, instant)), node="palm"))
        assert answer.json()["items"][0]["result"] == "stored"
        removed = stand.cloud.metrics.removed.labels("age")
        while removed._value.get() < 200:  # noqa: ASYNC110 - counted by the code under test
            await asyncio.sleep(0.01)
        stopping.set()
        await running
        assert stand.cloud.store.jobs - before >= 21
        assert rows(stand, sealed_messages) == []
        assert len(rows(stand, frames)) == 1


def test_first_place_that_fits_counts() -> None:
    rules = RetentionSection(
        days=30, biometric_days=7, channels={"hand/t01.*": 1, "hand/*": 0, "*/*.bioelectric": 2}
    )
    for place, kept in {
        "hand/t01.capacitance": 1,
        "hand/t05.bioelectric": 0,
        "palm/t05.bioelectric": 2,
        "palm/t05.pressure": 30,
    }.items():
        assert kept_for(rules, *place.split("/")) == kept
    assert kept_for(RetentionSection(days=30, biometric_days=7), "a", "t1.bioelectric") == 7
    assert kept_for(RetentionSection(), "a", "t1.bioelectric") == 0
