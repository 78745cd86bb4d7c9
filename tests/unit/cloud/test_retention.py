"""Retention by channel; copies of removed messages stay duplicates."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import cbor2
import pytest
from eskin_cloud.jobs.retention import apply_retention, kept_for, sweep
from eskin_cloud.settings import RetentionSection
from eskin_cloud.store.schema.sealed_tables import erased_subjects, removals, sealed_messages
from eskin_cloud.store.schema.tables import blocks, channels, events
from sqlalchemy import insert, select

from eskin.wire.timestamp import SECOND
from tests.support.identities import SITE
from tests.unit.cloud.clouds import Stand, batch, standing
from tests.unit.cloud.messages import CHANNEL, START, peak, stretch
from tests.unit.cloud.sealing import NODE as HAND
from tests.unit.cloud.sealing import Site, ask, beat, declared, physician, pulse, sealing

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from eskin.wire.messages import Block, Peak
    from tests.support.identities import Identities

pytestmark = pytest.mark.anyio
DAY = 86_400
OTHER = "t02.capacitance"


def days(number: float) -> dict[str, Any]:
    """The time of a message so many days after the start."""
    moment = START + int(number * DAY * SECOND)
    return {"time": (moment, moment)}


def rows(stand: Stand, table: Any) -> list[dict[str, Any]]:
    with stand.cloud.store.read() as connection:
        return [dict(row) for row in connection.execute(select(table)).mappings()]


def at_day(stand: Stand, number: float) -> None:
    stand.clock.now = START + int(number * DAY * SECOND)


async def test_each_channel_has_its_own_retention(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    rules = RetentionSection(days=3, channels={f"*/{OTHER}": 10}, at_once=4)
    with standing(tmp_path, identities, place=place, retention=rules) as stand:
        told = [stretch(10 + day, [float(day)], [day + 1.0], **days(day)) for day in range(9)]
        told += [stretch(30 + day, channel=OTHER, **days(day)) for day in range(9)]
        body = batch(*told, peak(50, **days(1)), peak(51, **days(8)))
        await stand.ingest(body)
        at_day(stand, 3)
        assert await sweep(stand.cloud) == 0
        at_day(stand, 8.5)
        assert await sweep(stand.cloud) == 7
        left = sorted(row["sequence"] for row in rows(stand, blocks))
        assert left == [16, 17, 18, *range(30, 39)]
        assert [row["sequence"] for row in rows(stand, events) if row["kind"] == "peak"] == [51]
        row = next(row for row in rows(stand, channels) if row["channel"] == CHANNEL)
        assert (row["blocks"], row["samples"]) == (3, 3)
        assert row["t_first"] == START + 6 * DAY * SECOND
        assert row["lo"] <= 6.0
        assert row["hi"] >= 9.0
        (why,) = rows(stand, removals)
        assert (why["channel"], why["reason"], why["messages"]) == (CHANNEL, "age", 7)
        assert b'eskin_cloud_removed_total{reason="age"} 7.0' in stand.cloud.metrics.write()
        again = (await stand.ingest(body)).json()["items"]
        assert {item["result"] for item in again} == {"duplicate"}
        assert len(rows(stand, blocks)) == 12


async def test_channel_restarts_after_removal_of_all_blocks(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    with standing(tmp_path, identities, place=place, retention=RetentionSection(days=1)) as stand:
        await stand.ingest(batch(stretch(1, [-5.0], [5.0]), stretch(2)))
        at_day(stand, 2)
        assert await sweep(stand.cloud) == 2
        await stand.ingest(batch(stretch(3, [1.0], [2.0], **days(2))))
        (row,) = rows(stand, channels)
        assert (row["blocks"], row["lo"], row["hi"]) == (1, 1.0, 2.0)
        path = f"/api/v1/series/fingertip/{CHANNEL}"
        answer = (await ask(stand, physician(stand), path)).json()
        assert answer["lo"] == [1.0]


async def test_sealed_messages_expire_by_time_or_arrival(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    site = Site(tmp_path)
    rules = RetentionSection(biometric_days=2)
    with sealing(tmp_path, identities, place=place, retention=rules) as stand:
        at_day(stand, 0)
        early: list[Block | Peak] = [pulse(1), beat(2), pulse(3, **days(300))]
        await stand.ingest(site.batch(declared(), *early))
        at_day(stand, 2 - 0.001)
        await stand.ingest(site.batch(pulse(4, **days(1)), stretch(9)))
        assert await sweep(stand.cloud) == 0
        at_day(stand, 2.01)
        assert await sweep(stand.cloud) == 3
        assert [row["sequence"] for row in rows(stand, sealed_messages)] == [4]
        path = f"/api/v1/nodes/{HAND}/channels"
        listed = (await ask(stand, physician(stand), path)).json()["items"]
        (told,) = [item for item in listed if item["biometric"]]
        # Its growth would show each peak.
        assert told["bytes"] is None
        assert told["removed"]["messages"] == 3
        assert told["removed"]["before"].startswith("2027-01-15T08:14:23")
        again = (await stand.ingest(site.batch(*early))).json()["items"]
        assert {item["result"] for item in again} == {"duplicate"}


async def test_messages_of_erased_subjects_are_removed(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    site = Site(tmp_path)
    bo = site.keystore.create("Bo")
    with sealing(tmp_path, identities, place=place) as stand:
        await stand.ingest(site.batch(declared(), *(pulse(n) for n in range(1, 20))))
        await stand.ingest(site.batch(pulse(20), subject=bo))
        gone = {"site": SITE, "subject": site.ada.pseudonym, "erased": 1}
        stand.cloud.store.write(lambda c: c.execute(insert(erased_subjects), gone)).result(120)
        assert await sweep(stand.cloud) == 19
        assert [row["subject"] for row in rows(stand, sealed_messages)] == [bo.pseudonym]
        (channel,) = [row for row in rows(stand, channels) if row["node"] == HAND]
        assert channel["blocks"] == 1
        assert [why["reason"] for why in rows(stand, removals)] == ["erasure"]


async def test_ingest_goes_on_between_the_steps(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    rules = RetentionSection(days=1, at_once=10, every_s=0.05)
    with standing(tmp_path, identities, place=place, retention=rules) as stand:
        await stand.ingest(batch(*(stretch(n) for n in range(200))))
        at_day(stand, 3)
        stopping = asyncio.Event()
        before = stand.cloud.store.writer.jobs
        running = asyncio.create_task(apply_retention(stand.cloud, stopping))
        late = cbor2.dumps([["palm", stretch(1, **days(3)).encode()]])
        answer = await stand.ingest(late)
        assert answer.json()["items"][0]["result"] == "stored"
        removed = stand.cloud.metrics.removed.labels("age")
        while removed._value.get() < 200:  # noqa: ASYNC110 - counted by the code under test
            await asyncio.sleep(0.01)
        stopping.set()
        await running
        assert stand.cloud.store.writer.jobs - before >= 21
        assert len(rows(stand, blocks)) == 1


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
