"""Sealed frames and statements answer a reader with the scope as public ones do."""

from __future__ import annotations

import asyncio
import json
from contextlib import aclosing
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import cbor2
import pytest
from eskin_cloud.access import Scope
from eskin_cloud.jobs.retention import sweep
from eskin_cloud.live.frame_encoder import FrameSelection
from eskin_cloud.live.frame_stream import FrameStream
from eskin_cloud.settings import RetentionSection
from eskin_cloud.store.feed_entry import FEED_START
from eskin_cloud.store.schema.frame_tables import frames, pages
from eskin_cloud.store.schema.sealed_tables import erased_subjects, removals, sealed_messages
from eskin_cloud.store.schema.tables import dead_letters, events
from sqlalchemy import insert, select

from eskin.wire.frames import EncodedFrame, Frame, Statements
from eskin.wire.timestamp import SECOND, parse_timestamp
from tests.support.identities import SITE
from tests.unit.cloud.clouds import batch, problem
from tests.unit.cloud.messages import START
from tests.unit.cloud.sealing import (
    NODE,
    Site,
    ask,
    kept,
    keyed,
    notice,
    physician,
    remains,
    sealing,
)
from tests.unit.cloud.skins import PALM, describe
from tests.unit.cloud.streams import entry_reader, events_of, listen
from tests.unit.cloud.worn import (
    CHANNEL,
    HEART,
    OPEN_WORN,
    PUBLIC_CHANNEL,
    TWIN,
    WORN,
    beats,
    bring_both,
    describe_worn,
    worn,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
SERIES = f"/api/v1/series/{NODE}/{CHANNEL}"
OPEN_SERIES = f"/api/v1/series/{TWIN}/{PUBLIC_CHANNEL}"
WIDE = {"start": START - SECOND, "end": START + 3600 * SECOND}
DAY = 86_400.0


@pytest.fixture
def stand(
    tmp_path: Path, identities: Identities, site: Site, place: StoreLocation
) -> Iterator[Stand]:
    with keyed(tmp_path, identities, site, place=place) as made:
        yield made


def rows(stand: Stand, table: Any) -> list[dict[str, Any]]:
    with stand.cloud.store.read() as connection:
        return [dict(row) for row in connection.execute(select(table)).mappings()]


async def test_sealed_channel_answers_as_the_same_channel_in_the_clear(
    stand: Stand, site: Site
) -> None:
    await bring_both(stand, site, 1, 2, 3, 5, 6)
    token = physician(stand)
    period = 10_000_000
    for path, params in (
        ("", WIDE | {"points": 1000}),
        ("", WIDE | {"points": 7}),
        ("", {"start": START + 30 * period, "end": START + 70 * period, "points": 3}),
        ("/time", WIDE | {"above": 0.5}),
        ("/threshold", WIDE | {"above": 0.5}),
        ("/threshold", WIDE | {"below": 0.0, "limit": 3}),
        ("/comparison", WIDE | {"other": f"{TWIN}/h0.voltage"}),
        ("/anomalies", WIDE | {"model": "constant", "parameter": "value:0:1"}),
    ):
        sealed = await ask(stand, token, SERIES + path, **params)
        plain = await ask(stand, token, OPEN_SERIES + path, **params)
        differ = {"node": None, "channel": None}
        assert sealed.status_code == 200, sealed.text
        assert json.loads(sealed.content) | differ == json.loads(plain.content) | differ


async def test_column_that_is_sampled_minutes_after_its_frame_is_found(
    stand: Stand, site: Site
) -> None:
    await bring_both(stand, site, 1)
    window = {"start": START + 89 * SECOND, "end": START + 120 * SECOND}
    answers = [
        (await ask(stand, physician(stand), f"/api/v1/series/{place}", **window)).json()
        for place in (f"{NODE}/h2.bioelectric", f"{TWIN}/h2.voltage")
    ]
    assert answers[0]["lo"] == answers[1]["lo"] != []


async def test_export_and_pictures_are_those_of_the_twin(stand: Stand, site: Site) -> None:
    await bring_both(stand, site, 1, 2)
    await stand.ingest(batch(worn(7, page=0), node=NODE))
    await stand.ingest(batch(worn(7, page=0, of=OPEN_WORN), node=TWIN))
    token = physician(stand)
    exports = [
        (await ask(stand, token, "/api/v1/export", channel=place, **WIDE)).text.splitlines()[1:]
        for place in (f"{NODE}/{CHANNEL}", f"{TWIN}/{PUBLIC_CHANNEL}")
    ]
    assert len(exports[0]) == 40
    assert [line.split(",")[2:] for line in exports[0]] == [
        line.split(",")[2:] for line in exports[1]
    ]
    window = {"start": START, "end": START + 2 * SECOND, "points": 20}
    pictures = [
        (
            await ask(stand, token, f"/api/v1/nodes/{node}/frames", quantity=quantity, **window)
        ).json()
        for node, quantity in ((NODE, "bioelectric"), (TWIN, "voltage"))
    ]
    differ = {"node": None, "layout": None, "quantity": None}
    assert pictures[0] | differ == pictures[1] | differ
    assert any(each is not None for row in pictures[0]["lo"] for each in row)
    beside = [
        (await ask(stand, token, f"/api/v1/nodes/{node}/frames", quantity="pressure", **window))
        for node in (NODE, TWIN)
    ]
    assert beside[0].json() | differ == beside[1].json() | differ


async def test_reader_without_the_scope_gets_nothing_of_it(stand: Stand, site: Site) -> None:
    await bring_both(stand, site, 1, 2)
    await stand.ingest(site.batch(beats(3)))
    assert "biometric" in problem(await stand.get(SERIES, **WIDE), 403)
    path = f"/api/v1/nodes/{NODE}"
    assert (await stand.get(path)).json()["sequence"] is None
    assert (await ask(stand, physician(stand), path)).json()["sequence"] == 3
    assert "biometric" in problem(
        await stand.get("/api/v1/export", channel=f"{NODE}/{CHANNEL}"), 403
    )
    assert (await stand.get("/api/v1/events", node=NODE)).json()["items"] == []
    found = await stand.get(f"/api/v1/nodes/{NODE}/frames", quantity="bioelectric", **WIDE)
    assert all(each is None for row in found.json()["lo"] for each in row)
    listed = (await stand.get(f"/api/v1/nodes/{NODE}/channels")).json()["items"]
    (channel,) = [each for each in listed if each["id"] == CHANNEL]
    assert channel["biometric"]
    assert channel["first"] is channel["last"] is channel["removed"] is None


async def test_times_of_a_listed_channel_are_whole_minutes(stand: Stand, site: Site) -> None:
    await bring_both(stand, site, 1, 2)
    token = physician(stand)
    found = [
        each
        for node in (NODE, TWIN)
        for each in (await ask(stand, token, f"/api/v1/nodes/{node}/channels")).json()["items"]
        if each["id"] in {CHANNEL, PUBLIC_CHANNEL}
    ]
    sealed, plain = found
    assert sealed["dt"] is None
    assert plain["dt"] > 0
    first, last = (parse_timestamp(sealed[name]) for name in ("first", "last"))
    assert (first % (60 * SECOND), last % (60 * SECOND)) == (0, 0)
    assert 0 <= parse_timestamp(plain["first"]) - first < 60 * SECOND
    assert first < last  # of the frames: one column is sampled minutes later


async def test_events_of_statements_are_those_of_the_twin_page_by_page(
    stand: Stand, site: Site
) -> None:
    describe_worn(stand.cloud.store)
    await stand.ingest(site.batch(beats(1, 5), beats(2, 3)))
    await stand.ingest(batch(beats(1, 5, of=OPEN_WORN), beats(2, 3, of=OPEN_WORN), node=TWIN))
    token = physician(stand)

    async def pages_of(**params: Any) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = []
        cursor: dict[str, str] = {}
        while True:
            answer = await ask(stand, token, "/api/v1/events", **params, **cursor)
            assert answer.status_code == 200, answer.text
            found += answer.json()["items"]
            if answer.json()["next"] is None:
                return found
            cursor = {"cursor": answer.json()["next"]}

    for params in ({}, {"verdict": "certain"}, {"kind": "peak"}):
        for order in ("asc", "desc"):
            plain = await pages_of(node=TWIN, order=order, limit=100, **params)
            for limit in (1, 2, 3, 100):
                sealed = await pages_of(node=NODE, order=order, limit=limit, **params)
                assert len({each["id"] for each in sealed}) == 8
                heights = sorted((each["time"]["lo"], each["height"]["lo"]) for each in sealed)
                assert heights == sorted(
                    (each["time"]["lo"], each["height"]["lo"]) for each in plain
                )
    of_channel = await pages_of(channel=CHANNEL, limit=1)
    assert len(of_channel) == 3
    assert {each["channel"] for each in of_channel} == {CHANNEL}


async def test_nothing_of_it_is_on_the_disk(stand: Stand, site: Site, tmp_path: Path) -> None:
    await stand.ingest(site.batch())
    describe_worn(stand.cloud.store)
    said: list[Frame | Statements] = [worn(1), worn(2), beats(3)]
    await stand.ingest(site.batch(*said))
    await ask(stand, physician(stand), SERIES, **WIDE, points=5)
    held = remains(tmp_path) + kept(stand.cloud.store)
    for each in said:
        data = each.encode()
        assert all(data[at : at + 16] not in held for at in range(120, len(data) - 16, 16))
    assert rows(stand, frames) == rows(stand, events) == []


async def test_sealed_frame_waits_for_its_layout_and_is_kept_once(stand: Stand, site: Site) -> None:
    body = site.batch(worn(1), beats(2))
    asked = (await stand.ingest(body)).json()["items"]
    assert [each["result"] for each in asked] == ["unknown_layout"] * 2
    assert WORN.content_hash.hex() in asked[0]["want"]
    describe_worn(stand.cloud.store)
    for result in ("stored", "duplicate"):
        answer = (await stand.ingest(site.batch(worn(1), beats(2)))).json()["items"]
        assert [each["result"] for each in answer] == [result] * 2
    other = (await stand.ingest(site.batch(replace(worn(2), position=worn(1).position)))).json()
    assert other["items"][0]["result"] == "rejected"


async def test_plain_biometric_frames_and_sealed_public_ones_are_refused_and_not_kept(
    stand: Stand, site: Site
) -> None:
    describe_worn(stand.cloud.store)
    plain = await stand.ingest(batch(worn(1), beats(2), node=NODE))
    public = await stand.ingest(site.batch(worn(3, page=0), replace(worn(4), page=2)))
    for answer in (plain, public):
        assert {item["result"] for item in answer.json()["items"]} == {"rejected"}
    # Not even under a number that is stored.
    await stand.ingest(site.batch(worn(5)))
    again = await stand.ingest(batch(worn(5), node=NODE))
    assert again.json()["items"][0]["result"] == "rejected"
    assert {row["data"] for row in rows(stand, dead_letters)} == {b""}
    assert rows(stand, frames) == []


async def test_frames_of_too_many_bytes_are_refused(
    stand: Stand, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    await bring_both(stand, site, 1, 2)
    for limit, most in (("MOST", 1), ("MOST_BYTES", len(worn(1).encode()))):
        with monkeypatch.context() as patched:
            patched.setattr(f"eskin_cloud.privacy.decrypted_window.{limit}", most)
            assert "ask for less" in problem(
                await ask(stand, physician(stand), SERIES, **WIDE), 422
            )


def look_for_erasures(stand: Stand) -> None:
    with stand.cloud.store.read() as connection:
        stand.cloud.key_access.apply_erasures(connection)


async def test_live_streams_show_it_with_the_scope_alone(stand: Stand, site: Site) -> None:
    look_for_erasures(stand)  # when no node's site is known yet
    describe_worn(stand.cloud.store)
    await stand.ingest(site.batch(worn(1), beats(2, 3)))
    await stand.ingest(batch(worn(3, page=0), node=NODE))
    feed = stand.cloud.feed
    for scopes, expected in (
        ([Scope.READ], ["frame"]),
        ([Scope.READ, Scope.BIOMETRIC], ["frame", "peak", "peak", "peak", "frame"]),
        ([Scope.READ], ["frame"]),  # also once another client was shown it
    ):
        sealed = Scope.BIOMETRIC in scopes
        reader = entry_reader(stand, *scopes)
        received: list[dict[str, Any]] = []
        pieces = listen(stand, reader=reader, sealed=sealed, heartbeat=0.2)
        async with asyncio.timeout(20), aclosing(pieces) as stream:  # type: ignore[type-var]  # a generator
            async for piece in stream:
                received += events_of(piece)
                if b"heartbeat" in piece:
                    break
        assert [each["event"] for each in received] == expected
        if sealed:
            hull = received[0]["data"]["patches"][0]
            assert hull["lo"][:2] == worn(1).values[0].inf[:, :2].min(axis=0).tolist()
            assert len({each["id"] for each in received[1:4]}) == 2, "the last one ends the message"
            assert len({each["data"]["id"] for each in received[1:4]}) == 3
        messages: list[Any] = []
        frame_stream = FrameStream(
            feed, stand.cloud.contacts, selection=FrameSelection(), position=FEED_START,
            backlog=1000, heartbeat=0.2, reader=reader, sealed=sealed,
        )  # fmt: skip
        async with asyncio.timeout(20), aclosing(frame_stream.messages()) as stream:
            async for message in stream:
                messages.append(cbor2.loads(message))
                if messages[-1][0] == "lagging" and len(messages) > 1:
                    break
        kinds = [each[2] if each[0] == "event" else each[0] for each in messages]
        kinds = [each for each in kinds if each not in {"lagging", "layout"}]
        assert kinds == expected
        found = [each[4] for each in messages if each[0] == "frame"]
        public = worn(3, page=0).encode()
        if sealed:
            assert found == [worn(1).encode(), public]
        else:  # its number would count what is sealed
            (shown,) = map(Frame.decode, found)
            assert shown.position.sequence != 3
            assert replace(shown, position=worn(3).position).encode() == public


async def test_live_streams_state_that_they_leave_out_what_no_key_opens_at_present(
    stand: Stand, site: Site
) -> None:
    key = stand.cloud.key_access.of(SITE).directory / "subjects" / site.ada.pseudonym
    whole, allowed = key.read_bytes(), (Scope.READ, Scope.BIOMETRIC)
    key.write_bytes(b"damaged")
    describe_worn(stand.cloud.store)
    await stand.ingest(site.batch(worn(1), worn(2)))
    await stand.ingest(batch(worn(3, page=0), node=NODE))
    look_for_erasures(stand)
    async with aclosing(listen(stand, reader=entry_reader(stand, *allowed))) as pieces:  # type: ignore[type-var]  # a generator
        found = [events_of(await anext(pieces)) for _ in range(2)]
    assert [[each["event"] for each in events] for events in found] == [[], ["lagging", "frame"]]
    stated, frame = found[1]
    place = {
        name: stand.cloud.feed.ids.read_position(text) for name, text in stated["data"].items()
    }
    assert place["after"] == FEED_START
    assert place["resumed"] == stand.cloud.feed.ids.read_position(frame["id"])
    look_for_erasures(stand)
    frame_stream = FrameStream(
        stand.cloud.feed, stand.cloud.contacts, selection=FrameSelection(), backlog=1000,
        position=FEED_START, heartbeat=30.0, reader=entry_reader(stand, *allowed), sealed=True,
    )  # fmt: skip
    async with aclosing(frame_stream.messages()) as messages:
        heard = [cbor2.loads(await anext(messages)) for _ in range(4)]
        assert [each[0] for each in heard] == ["lagging", "lagging", "layout", "frame"]
        assert heard[1][2] is None
        key.write_bytes(whole)
        await stand.ingest(site.batch(worn(4)))
        heard = [cbor2.loads(await anext(messages)) for _ in range(2)]
    assert [each[0] for each in heard] == ["lagging", "frame"]
    assert heard[0][2] is None
    assert heard[1][4] == worn(4).encode()


async def test_live_streams_state_once_a_key_comes_that_they_left_something_out(
    tmp_path: Path, identities: Identities, site: Site, place: StoreLocation
) -> None:
    with sealing(tmp_path, identities, place=place) as stand:
        look_for_erasures(stand)
        describe_worn(stand.cloud.store)
        allowed = Scope.READ, Scope.BIOMETRIC
        frame_stream = FrameStream(
            stand.cloud.feed, stand.cloud.contacts, selection=FrameSelection(), backlog=1000,
            position=FEED_START, heartbeat=30.0, reader=entry_reader(stand, *allowed), sealed=True,
        )  # fmt: skip
        pieces = listen(stand, reader=entry_reader(stand, *allowed))
        async with (
            asyncio.timeout(20),
            aclosing(pieces) as events,  # type: ignore[type-var]  # a generator
            aclosing(frame_stream.messages()) as messages,
        ):
            await anext(events)
            await anext(messages)
            await stand.ingest(site.batch(worn(1)))
            await stand.ingest(batch(worn(2, page=0), node=NODE))
            assert [each["event"] for each in events_of(await anext(events))] == ["frame"]
            heard = [cbor2.loads(await anext(messages)) for _ in range(2)]
            assert [each[0] for each in heard] == ["layout", "frame"]
            stand.cloud.key_access.of(SITE).keep(site.ada.pseudonym, site.ada.key)
            look_for_erasures(stand)
            await stand.ingest(site.batch(worn(3)))
            await stand.ingest(site.batch(worn(4)))
            kinds: list[str] = []
            while kinds.count("frame") < 2:
                kinds += [each["event"] for each in events_of(await anext(events))]
            assert kinds == ["lagging", "frame", "frame"]
            heard = [cbor2.loads(await anext(messages)) for _ in range(3)]
            assert [each[0] for each in heard] == ["lagging", "frame", "frame"]
            assert heard[0][2] is None
            assert [each[4] for each in heard[1:]] == [worn(3).encode(), worn(4).encode()]


async def test_export_of_a_subject_holds_each_channel_and_event(stand: Stand, site: Site) -> None:
    describe_worn(stand.cloud.store)
    await stand.ingest(site.batch(worn(1), beats(2, 3)))
    await notice(stand, [[site.ada.pseudonym, NODE, site.ada.key]], [])
    answer = await ask(stand, physician(stand), f"/api/v1/subjects/{site.ada.pseudonym}/export")
    lines = [json.loads(line) for line in answer.text.splitlines()]
    samples = {each["channel"]: each for each in lines if each["kind"] == "frame"}
    values = worn(1).values[0]
    assert samples["h1.bioelectric"]["lo"] == values.inf[:, 1].tolist()
    assert samples["h2.bioelectric"]["hi"] == values.sup[1::4, 2].tolist()
    assert samples["h2.bioelectric"]["dt"] == 40_000_000
    assert [each["kind"] for each in lines] == ["frame"] * 3 + ["peak"] * 3


async def test_frames_of_an_erased_subject_are_gone_and_removed(stand: Stand, site: Site) -> None:
    await bring_both(stand, site, 1, 2)
    bo = site.keystore.create("Bo")
    await stand.ingest(site.batch(worn(3), subject=bo))
    await stand.ingest(site.batch(beats(4)))
    await notice(stand, [], [site.ada.pseudonym])
    window = {"start": START, "end": START + SECOND}
    problem(await ask(stand, physician(stand), SERIES, **window), 410)
    assert await sweep(stand.cloud) == 3
    assert [row["subject"] for row in rows(stand, sealed_messages)] == [bo.pseudonym]
    (page,) = [row for row in rows(stand, pages) if row["node"] == NODE]
    assert page["frames"] == 1
    late = (await stand.ingest(site.batch(worn(1)))).json()["items"]
    assert late[0]["result"] == "duplicate"


async def test_messages_that_arrive_after_the_erasure_are_not_stored(
    stand: Stand, site: Site
) -> None:
    await bring_both(stand, site, 1)
    await notice(stand, [], [site.ada.pseudonym])
    assert await sweep(stand.cloud) == 1
    bo = site.keystore.create("Bo")
    mixed = site.batch(worn(2), beats(3)), site.batch(worn(4), subject=bo)
    for waiting in mixed:
        items = (await stand.ingest(waiting)).json()["items"]
        assert {item["result"] for item in items} == {"stored"}
    assert [row["subject"] for row in rows(stand, sealed_messages)] == [bo.pseudonym]
    again = (await stand.ingest(site.batch(worn(2), beats(3)))).json()["items"]
    assert [item["result"] for item in again] == ["duplicate", "duplicate"]
    (page,) = [row for row in rows(stand, pages) if row["node"] == NODE]
    assert page["frames"] == 1
    gone = [row for row in rows(stand, removals) if row["reason"] == "erasure"]
    assert sum(row["messages"] for row in gone) == 3
    assert rows(stand, dead_letters) == []
    assert await sweep(stand.cloud) == 0


async def test_frames_expire_by_time_or_arrival(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    site = Site(tmp_path)
    rules = RetentionSection(biometric_days=2, channels={f"{NODE}/h1.*": 3})
    with sealing(tmp_path, identities, place=place, retention=rules) as stand:
        describe(stand.cloud.store, WORN, PALM, HEART, node=NODE)
        stand.clock.turn((START - stand.clock()) / SECOND)
        await stand.ingest(site.batch(beats(1)))
        await stand.ingest(site.batch(worn(2), worn(3, at=300 * int(DAY) * SECOND)))
        await stand.ingest(batch(worn(4, page=0), node=NODE))
        stand.clock.turn(2.5 * DAY)
        await stand.ingest(site.batch(worn(5, at=int(2.4 * DAY) * SECOND)))
        assert await sweep(stand.cloud) == 0, "one channel is kept for three days"
        stand.clock.turn(0.6 * DAY)
        assert await sweep(stand.cloud) == 3
        assert [row["sequence"] for row in rows(stand, sealed_messages)] == [5]
        assert [row["sequence"] for row in rows(stand, frames)] == [4]
        path = f"/api/v1/nodes/{NODE}/channels"
        listed = (await ask(stand, physician(stand), path)).json()["items"]
        (channel,) = [item for item in listed if item["id"] == CHANNEL]
        assert channel["removed"]["messages"] == 2
        assert {row["reason"] for row in rows(stand, removals)} == {"age"}


def test_examples_are_read_by_their_layout() -> None:
    for of, patches in ((WORN, (PALM, HEART)),):
        of.require_patches(patches)
        worn(1).require_layout(of, patches)
    assert isinstance(EncodedFrame.decode(worn(1).encode()), EncodedFrame)
    assert Frame.decode(worn(1).encode()) == worn(1)


async def test_store_keeps_erasures_of_its_own_site_only(stand: Stand, site: Site) -> None:
    await bring_both(stand, site, 1)
    gone = {"site": "elsewhere", "subject": site.ada.pseudonym, "erased": 1}
    stand.cloud.store.write(lambda c: c.execute(insert(erased_subjects), gone)).result(120)
    assert await sweep(stand.cloud) == 0
    here = gone | {"site": SITE}
    stand.cloud.store.write(lambda c: c.execute(insert(erased_subjects), here)).result(120)
    assert await sweep(stand.cloud) == 1
