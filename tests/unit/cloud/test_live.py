"""The live stream: everything in order, nothing silently left out."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncGenerator
from contextlib import aclosing
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.live.frame_hulls import read_hulls
from eskin_cloud.live.sse_encoder import Subscription
from eskin_cloud.settings import LiveSection

from eskin.wire.timestamp import format_timestamp
from tests.unit.cloud.brute_force import compact_all
from tests.unit.cloud.clouds import batch, forget_recent, numbers, problem, put, standing
from tests.unit.cloud.messages import DT, NODE, START, gap, peak, status, stretch, tube_of
from tests.unit.cloud.streams import events_of, listen, parse, take

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_cloud.live.frame_hulls import FrameHulls
    from eskin_cloud.store.feed_entry import FeedEntry
    from eskin_cloud.store.location import StoreLocation

    from eskin.wire.frames import Frame
    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


async def test_subscriber_hears_what_is_ingested_in_order(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin_cloud.live.stream.PATIENCE_S", math.inf)  # however slowly it reads
    hearing = asyncio.create_task(take(stand, 5))
    await stand.ingest(batch(status(0), stretch(1), peak(2)))
    await stand.ingest(batch(stretch(1), gap(3), stretch(4)))
    heard = await hearing
    assert [event["event"] for event in heard] == ["status", "frame", "peak", "gap", "frame"]
    assert [int(event["id"]) for event in heard] == [1, 2, 3, 4, 5]
    listed = (await stand.get("/api/v1/events", order="asc")).json()["items"]
    events = [event["data"] for event in heard if event["event"] != "frame"]
    assert sorted(events, key=lambda e: e["id"]) == sorted(listed, key=lambda e: e["id"])


async def test_frame_states_when_it_was_stored(stand: Stand) -> None:
    stored = []
    for number in range(3):
        stand.clock.turn(1.0)
        stored.append(format_timestamp(stand.clock()))
        await stand.ingest(batch(stretch(number, time=(START + 10 * number * DT,) * 2)))
    assert [event["data"]["stored"] for event in await take(stand, 3)] == stored
    forget_recent(stand)
    assert [event["data"]["stored"] for event in await take(stand, 3)] == stored


@pytest.mark.parametrize("recent", [1, 1000])
async def test_every_cursor_resumes_without_a_hole(
    tmp_path: Path, identities: Identities, place: StoreLocation, recent: int
) -> None:
    with standing(tmp_path, identities, place=place, live=LiveSection(recent=recent)) as stand:
        said = [peak(n) if n % 3 else stretch(n) for n in range(300)]
        for first in range(0, 300, 100):
            await stand.ingest(batch(*said[first : first + 100]))
        for cursor in (0, 1, 63, 64, 65, 200, 298, 299):
            heard = await take(stand, 300 - cursor, cursor=cursor)
            assert [int(event["id"]) for event in heard] == list(range(cursor + 1, 301))


async def test_stream_from_before_the_start_reads_the_store(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    with standing(tmp_path, identities, place=place) as stand:
        put(stand.cloud.store, stretch(0), gap(1))
    with standing(tmp_path, identities, place=place) as stand:
        await stand.ingest(batch(stretch(2)))
        heard = await take(stand, 3)
    assert [event["event"] for event in heard] == ["frame", "gap", "frame"]


async def test_subscriber_that_is_too_far_behind_is_notified(stand: Stand) -> None:
    await stand.ingest(batch(*(peak(n) for n in range(20))))
    heard = await take(stand, 6, backlog=5, cursor=3)
    assert heard[0]["event"] == "lagging"
    assert heard[0]["data"] == {"after": "3", "resumed": "15"}
    assert [int(event["id"]) for event in heard[1:]] == [16, 17, 18, 19, 20]


async def test_subscriber_that_comes_back_after_compaction_learns_that_frames_are_missing(
    stand: Stand,
) -> None:
    await stand.ingest(batch(stretch(0), stretch(1), peak(2), stretch(3)))
    await asyncio.to_thread(compact_all, stand.cloud.store)
    await stand.ingest(batch(stretch(4), gap(5)))
    forget_recent(stand)
    heard = await take(stand, 4, cursor=1)
    assert [(each["event"], int(each["id"])) for each in heard] == [
        ("lagging", 1), ("peak", 3), ("frame", 5), ("gap", 6)
    ]  # fmt: skip
    assert heard[0]["data"] == {"after": "1", "resumed": "4"}
    heard = await take(stand, 2, cursor=4)
    assert [each["event"] for each in heard] == ["frame", "gap"], "nothing is missing from there on"


async def test_slow_subscriber_misses_nothing_and_costs_no_memory(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    with standing(tmp_path, identities, place=place, live=LiveSection(recent=10)) as stand:
        async with aclosing(listen(stand)) as slow:  # type: ignore[type-var]  # a generator
            await anext(slow)
            heard = []
            for number in range(50):
                await stand.ingest(batch(*(peak(10 * number + k) for k in range(10))))
                if number % 10 == 0:
                    heard += events_of(await anext(slow))
            while len(heard) < 500:
                heard += events_of(await anext(slow))
        assert numbers(int(event["data"]["id"]) for event in heard) == list(range(1, 501))
        assert int(heard[-1]["id"]) == 500
        assert len(stand.cloud.feed._recent) == 10


async def test_slow_subscriber_gets_fewer_and_wider_hulls(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin_cloud.live.stream.PAUSE_S", 1e-9)
    monkeypatch.setattr("eskin_cloud.live.stream.PATIENCE_S", -1.0)  # however quickly it reads

    def said(first: int, instant: int) -> Frame:
        lo = np.random.default_rng(first).normal(size=10)
        return stretch(first, lo, lo + 1, time=(START + instant * DT,) * 2, coverage=0.999)

    stated = [said(n, 10 * n) for n in range(5)] + [said(6, 10 * 6)]  # the sixth is missing
    other = stretch(7, [3.0], [4.0], channel="t02.capacitance")
    async with aclosing(listen(stand)) as slow:  # type: ignore[type-var]  # a generator
        await anext(slow)
        await stand.ingest(batch(said(8, -10)))
        assert [event["id"] for event in events_of(await anext(slow))] == ["1"]
        assert await anext(slow) == b""  # there is room, after a while
        await stand.ingest(batch(*stated[:3], peak(9)))
        await stand.ingest(batch(other, node="palm"))
        stand.clock.turn(1.0)
        await stand.ingest(batch(*stated[3:]))
        heard = events_of(await anext(slow))
    hulls = [event["data"] for event in heard if event["event"] == "frame"]
    patches = [hull["patches"][0] for hull in hulls]
    names = ["t01-capacitance", "t02-capacitance", "t01-capacitance"]
    assert [each["patch"] for each in patches] == names
    assert [event["event"] for event in heard] == ["frame"] * 3 + ["peak"]
    now, before = stand.clock(), stand.clock() - 10**9
    latest = [format_timestamp(instant) for instant in (now, before, now)]
    assert [hull["stored"] for hull in hulls] == latest
    # A client that breaks off before the last is stated all of it again.
    assert [event["id"] for event in heard] == ["1", "1", "1", "9"]
    for hull, frames in ((hulls[0], stated[:5]), (hulls[2], stated[5:])):
        (of_patch,) = hull["patches"]
        tubes = [tube_of(one) for one in frames]
        assert hull["t0"] == format_timestamp(tubes[0].first_instant)
        assert (of_patch["t"], of_patch["dt"]) == (0, 10 * DT * len(frames))
        assert of_patch["lo"] == [min(tube.values.inf.min() for tube in tubes)]
        assert of_patch["hi"] == [max(tube.values.sup.max() for tube in tubes)]
        assert of_patch["coverage"] <= 1 - 10 * len(frames) * 0.001
        assert of_patch["coverage"] == pytest.approx(1 - 10 * len(frames) * 0.001)


async def test_slow_subscriber_gets_hulls_until_there_is_room_at_once(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr("eskin_cloud.live.stream.time", SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr("eskin_cloud.live.stream.PAUSE_S", 1e-9)
    stated = []
    async with aclosing(listen(stand)) as slow:  # type: ignore[type-var]  # a generator
        await anext(slow)
        for number, wait in enumerate((0.1, 0.3, 0.01, *[0.1] * 10, 0.01, 0.1)):
            instants = [START + (2 * number + k) * DT for k in range(2)]
            two = (stretch(2 * number + k, time=(t, t)) for k, t in enumerate(instants))
            await stand.ingest(batch(*two))
            stated.append(len(events_of(await anext(slow))))
            assert await anext(slow) == b""
            now[0] += wait  # until there is room
    assert stated == [2, 2, *[1] * 12, 2]


async def test_what_was_missed_is_stated_in_full_also_to_a_slow_client(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin_cloud.live.stream.PAUSE_S", 1e-9)
    monkeypatch.setattr("eskin_cloud.live.stream.PATIENCE_S", -1.0)
    await stand.ingest(batch(*(stretch(n) for n in range(200))))
    heard = await take(stand, 200)
    assert [int(event["id"]) for event in heard] == list(range(1, 201))


async def test_many_subscribers_cost_one_reduction_each_frame(
    stand: Stand, monkeypatch: pytest.MonkeyPatch
) -> None:
    reduced: list[int] = []

    def counting(entry: FeedEntry, *rest: Any) -> FrameHulls | None:
        reduced.append(entry.cursor)
        return read_hulls(entry, *rest)

    monkeypatch.setattr("eskin_cloud.live.sse_encoder.read_hulls", counting)
    await stand.ingest(batch(*(stretch(n, [1.0] * 4, [2.0] * 4) for n in range(3))))
    first, *others = [await take(stand, 3) for _ in range(5)]
    assert all(heard == first for heard in others)
    assert numbers(sorted(reduced)) == [1, 2, 3]


async def test_memory_of_the_feed_is_bounded_in_bytes_and_nothing_is_missed(stand: Stand) -> None:
    feed, said = stand.cloud.feed, [stretch(n) if n % 5 else peak(n) for n in range(100)]
    feed._most_bytes = 10 * len(said[1].encode())
    await stand.ingest(batch(*said))
    assert 5 < len(feed._recent) < 20
    assert feed._used == sum(entry.size for entry in feed._recent) <= feed._most_bytes
    heard = await take(stand, 100)
    assert [int(event["id"]) for event in heard] == list(range(1, 101))


async def test_filters_choose_nodes_and_channels(stand: Stand) -> None:
    other = "t02.capacitance"
    said = stretch(0), stretch(1, channel=other), gap(2), peak(3, channel=other)
    await stand.ingest(batch(*said))
    await stand.ingest(batch(stretch(0), node="palm"))
    chosen = {
        "node": (Subscription(frozenset({"palm"}), frozenset()), [5]),
        "channel": (Subscription(frozenset(), frozenset({(NODE, other)})), [2, 3, 4]),
    }
    for selection, cursors in chosen.values():
        heard = await take(stand, len(cursors), selection=selection)
        assert [int(event["id"]) for event in heard] == cursors


async def test_heartbeat_comes_in_silence(stand: Stand) -> None:
    stated = listen(stand, heartbeat=0.01)
    async with asyncio.timeout(20):
        pieces = [await anext(stated) for _ in range(3)]
    assert pieces[1:] == [b"id: 0\n: heartbeat\n\n"] * 2
    assert isinstance(stated, AsyncGenerator)
    await stated.aclose()
    assert stand.cloud.feed.subscribers == 0


async def test_stream_cut_before_its_first_event_states_where_to_go_on(
    stand: Stand,
) -> None:
    await stand.ingest(batch(stretch(0), stretch(1)))
    palm = Subscription(frozenset({"palm"}), frozenset())
    stated = listen(stand, cursor=1, selection=palm, heartbeat=0.01)
    async with asyncio.timeout(20):
        assert parse(await anext(stated))["id"] == "1"
        assert parse(await anext(stated)) == {"id": "2", "comment": "heartbeat"}


async def test_closing_feed_ends_streams(stand: Stand) -> None:
    hearing = asyncio.create_task(take(stand, 1))
    await asyncio.sleep(0)
    stand.cloud.feed.close()
    assert await hearing == []


async def test_stream_is_refused_with_what_to_do(stand: Stand) -> None:
    async with stand.client() as client:
        answer = await client.get("/api/v1/live", headers={"Last-Event-ID": "x"})
        assert "leave it out" in problem(answer, 422)
        answer = await client.get("/api/v1/live", params={"channel": "t01.capacitance"})
        assert "NODE/CHANNEL" in problem(answer, 422)
    stand.cloud.feed.subscribers = stand.cloud.settings.live.subscribers
    answer = await stand.get("/api/v1/live")
    problem(answer, 503)
    assert answer.headers["retry-after"]
