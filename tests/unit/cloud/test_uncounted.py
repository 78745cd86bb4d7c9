"""A reader without the scope sees the same of two clouds that differ in sealed data alone."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from eskin_cloud.live.sse_encoder import Subscription
from eskin_cloud.live.stream import stream
from eskin_cloud.query.opaque_ids import OpaqueIds, UnknownCursorError
from eskin_cloud.store.feed_entry import FEED_START

from eskin.wire.messages import Position
from eskin.wire.timestamp import SECOND
from tests.unit.cloud.clouds import Stand, batch
from tests.unit.cloud.messages import START, peak, status, stretch
from tests.unit.cloud.sealing import CHANNEL, NODE, Site, ask, beat, keyed, physician, pulse
from tests.unit.cloud.streams import entry_reader
from tests.unit.cloud.worn import beats as heartbeats
from tests.unit.cloud.worn import describe_worn, worn

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_cloud.store.feed_entry import FeedPosition

    from tests.support.identities import Identities

pytestmark = pytest.mark.anyio

OPEN = "t00.capacitance"
EVERYTHING = Subscription(frozenset(), frozenset())
WINDOW = f"start={START - SECOND}&end={START + 3600 * SECOND}"
QUESTIONS = (
    "/api/v1/nodes",
    f"/api/v1/nodes/{NODE}",
    f"/api/v1/nodes/{NODE}/channels",
    f"/api/v1/nodes/{NODE}/commands",
    "/api/v1/gateways",
    "/api/v1/storage",
    "/api/v1/events?limit=1",
    "/api/v1/events?limit=1000&order=asc",
    f"/api/v1/series/{NODE}/{OPEN}?{WINDOW}",
    f"/api/v1/export?channel={NODE}/{OPEN}&limit=1&{WINDOW}",
    f"/api/v1/series/{NODE}/{CHANNEL}?{WINDOW}",
    f"/api/v1/nodes/{NODE}/layout",
    f"/api/v1/nodes/{NODE}/frames",
    f"/api/v1/nodes/{NODE}/frames?quantity=bioelectric&{WINDOW}",
    f"/api/v1/contacts?node={NODE}",
    f"/api/v1/nodes/{NODE}/gestures",
    f"/api/v1/series/{NODE}/palm-0.pressure",
    f"/api/v1/series/{NODE}/h1.bioelectric",
    f"/api/v1/export?channel={NODE}/palm-0.pressure",
    "/metrics",
)


@pytest.fixture
def two(tmp_path: Path, identities: Identities, site: Site) -> Iterator[tuple[Stand, Stand]]:
    with (
        keyed(tmp_path / "few", identities, site) as few,
        keyed(tmp_path / "many", identities, site) as many,
    ):
        for stand in (few, many):
            # Keys and tokens are drawn anew in each cloud; here nothing else may differ.
            stand.cloud.feed.ids = stand.cloud.feed.encoder.ids = OpaqueIds(bytes(32))
        yield few, many


async def live(
    stand: Stand, position: FeedPosition, *, sealed: bool, backlog: int = 10_000
) -> bytes:
    """What a stream sends from a place on until its first sign of life."""
    heard = b""
    pieces = stream(
        stand.cloud.feed,
        EVERYTHING,
        position=position,
        backlog=backlog,
        heartbeat=0.2,
        reader=entry_reader(stand),
        sealed=sealed,
    )
    async for piece in pieces:
        heard += piece
        if b"heartbeat" in piece:
            break

    return heard


async def bring(stand: Stand, site: Site, beats: int) -> None:
    """The same in the open, and so many sealed peaks and frames between."""
    declared = status(0)
    describe_worn(stand.cloud.store)
    await stand.ingest(site.batch(declared, pulse(1), beat(2), worn(3)))
    sequence = 4
    for k in range(4):
        await stand.ingest(batch(stretch(sequence, channel=OPEN), node=NODE))
        await stand.ingest(batch(peak(sequence + 1, channel=OPEN), node=NODE))
        # The same samples at the same time, whatever the number.
        frame = replace(worn(k, page=0), position=Position(1, sequence + 2))
        await stand.ingest(batch(frame, node=NODE))
        sequence += 3
        for _ in range(beats + k):
            await stand.ingest(site.batch(beat(sequence), pulse(sequence + 1)))
            of_frames = worn(sequence + 2, at=sequence * 60 * SECOND), heartbeats(sequence + 3)
            await stand.ingest(site.batch(*of_frames))
            sequence += 4
    stand.clock.turn(1.0)


def without_what_is_drawn(text: str) -> str:
    """Opaque numbers of the export belong to positions, which differ; their texts say nothing."""
    text = re.sub(r"cursor=[A-Za-z0-9_-]+", "cursor=", text)
    return re.sub(r'("next":)"[^"]*"', r"\1", text)


async def answers(stand: Stand, token: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for question in QUESTIONS:
        answer = await ask(stand, token, question)
        headers = {n: v for n, v in answer.headers.items() if n not in {"date", "link"}}
        found[question] = (answer.status_code, headers, without_what_is_drawn(answer.text))
    return found


async def test_reader_without_the_scope_cannot_count_what_is_sealed(
    two: tuple[Stand, Stand], site: Site
) -> None:
    few, many = two
    await bring(few, site, 1)
    await bring(many, site, 9)
    seen = [await answers(stand, stand.token) for stand in two]
    for question in QUESTIONS:
        a, b = (mask_ids(found[question]) for found in seen)
        if question == "/metrics":
            a, b = (figures(text) for _, _, text in (a, b))
        elif "/export" in question:
            a, b = (columns(text) for _, _, text in (a, b))
        assert a == b, question
    with_scope = await ask(many, physician(many), f"/api/v1/nodes/{NODE}")
    assert with_scope.json()["sequence"] > 10


def mask_ids(found: Any) -> Any:
    """Ids are texts of one length that name places; which ones they name differs."""
    code, headers, text = found
    headers = {n: v for n, v in headers.items() if n != "content-length"}
    return code, headers, re.sub(r'"id":"[A-Za-z0-9_-]{20,}"', '"id":""', text)


def figures(text: str) -> dict[str, str]:
    """Figures that do not measure this machine's speed."""
    lines = [line.rpartition(" ") for line in text.splitlines() if not line.startswith("#")]
    own = ("_created", "_bucket", "_sum", "requests_total", "writes_waiting")
    return {name: value for name, _, value in lines if not any(word in name for word in own)}


def columns(text: str) -> list[list[str]]:
    """An export's rows without their last column, the opaque number."""
    return [line.split(",")[:-1] for line in text.splitlines()]


async def test_live_stream_without_the_scope_discloses_nothing_sealed(
    two: tuple[Stand, Stand], site: Site
) -> None:
    few, many = two
    await bring(few, site, 1)
    await bring(many, site, 9)
    shapes = []
    for stand in two:
        for backlog in (10_000, 12, 5):
            heard = (await live(stand, FEED_START, sealed=False, backlog=backlog)).decode()
            ids = re.findall(r"^id: (\S+)$", heard, re.MULTILINE)
            names: dict[str, int] = {}
            order = [names.setdefault(each, len(names)) for each in ids]
            events = re.findall(r"^event: (\w+)$", heard, re.MULTILINE)
            shapes.append((backlog, order, events, re.sub(r"[A-Za-z0-9_-]{22,}", "", heard)))
    assert shapes[:3] == shapes[3:]


async def test_id_stays_the_same_while_only_sealed_messages_come(
    two: tuple[Stand, Stand], site: Site
) -> None:
    stand, _ = two
    await bring(stand, site, 1)
    before = await live(stand, stand.cloud.feed.last, sealed=False)
    known = await live(stand, stand.cloud.feed.last, sealed=True)
    for sequence in range(100, 120, 2):
        await stand.ingest(site.batch(beat(sequence), worn(sequence + 1)))
    assert await live(stand, stand.cloud.feed.last, sealed=False) == before
    assert await live(stand, stand.cloud.feed.last, sealed=True) != known


def test_opaque_number_is_read_back_and_forged_ones_are_refused() -> None:
    ids, other = OpaqueIds(bytes(32)), OpaqueIds(bytes(31) + b"\x01")
    text = ids.write(5, -7, 2**62)
    assert ids.read(text, 3) == [5, -7, 2**62]
    assert len(ids.write(1)) != 0
    for forged in ("", "x", text[:-2], other.write(5, -7, 2**62), "é" * 30):
        with pytest.raises(UnknownCursorError):
            ids.read(forged, 3)
