"""A client without the scope gets the same frames and cursors, whatever is sealed between them."""

from __future__ import annotations

from contextlib import aclosing
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import cbor2
import pytest
from eskin_cloud.live.frame_encoder import FrameSelection
from eskin_cloud.live.frame_stream import FrameStream
from eskin_cloud.store.feed_entry import FEED_START

from eskin.wire.frames import Frame
from eskin.wire.messages import Position
from tests.unit.cloud.clouds import batch
from tests.unit.cloud.messages import peak, status
from tests.unit.cloud.sealing import NODE, Site, beat, keyed, pulse
from tests.unit.cloud.streams import entry_reader
from tests.unit.cloud.worn import beats as heartbeats
from tests.unit.cloud.worn import describe_worn, worn

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio
OPEN = "t00.capacitance"


@pytest.fixture
def two(tmp_path: Path, identities: Identities, site: Site) -> Iterator[tuple[Stand, Stand]]:
    with (
        keyed(tmp_path / "few", identities, site) as few,
        keyed(tmp_path / "many", identities, site) as many,
    ):
        yield few, many


async def bring(stand: Stand, site: Site, beats: int) -> None:
    """The same frames and peaks, and so many sealed messages between."""
    describe_worn(stand.cloud.store)
    await stand.ingest(site.batch(status(0), pulse(1), beat(2)))
    sequence = 3
    for number in range(4):
        frame = replace(worn(number, page=0), position=Position(1, sequence))
        await stand.ingest(batch(frame, peak(sequence + 1, channel=OPEN), node=NODE))
        sequence += 2
        for _ in range(beats + number):
            await stand.ingest(site.batch(beat(sequence), pulse(sequence + 1)))
            of_frames = worn(sequence + 2, at=sequence), heartbeats(sequence + 3)
            await stand.ingest(site.batch(*of_frames))
            sequence += 4
    stand.clock.turn(1.0)


async def received(stand: Stand, *, sealed: bool, backlog: int) -> list[Any]:
    """What a stream sends until its first sign of life, cursors by the order of their appearance.

    Sequences, and times that follow the clock, are left out: what they say is as in the store.
    """
    feed = stand.cloud.feed
    frames = FrameStream(
        feed,
        stand.cloud.contacts,
        selection=FrameSelection(),
        position=FEED_START,
        backlog=backlog,
        heartbeat=0.2,
        reader=entry_reader(stand),
        sealed=sealed,
    )
    found: list[Any] = []
    order: dict[str, int] = {}
    async with aclosing(frames.messages()) as messages:
        async for message in messages:
            kind, *rest = cbor2.loads(message)
            if kind == "layout":
                found.append((kind, *rest))
                continue
            place = order.setdefault(rest[0], len(order))
            if kind == "lagging" and rest[1] == 0 and found and found[-1][1] == place:
                return found
            if kind == "frame":
                stated = Frame.decode(rest[3])
                assert (stated.position.sequence < 1000) is sealed, "no other client may count"
                found.append((kind, place, replace(stated, position=Position(1, 0)).encode()))
                continue
            found.append((kind, place, rest[1]))
    return found


@pytest.mark.parametrize(
    "backlog",
    [
        pytest.param(10_000, marks=pytest.mark.nightly),
        12,
        pytest.param(5, marks=pytest.mark.nightly),
    ],
)
async def test_what_is_sealed_shows_in_no_message(
    two: tuple[Stand, Stand], site: Site, backlog: int
) -> None:
    few, many = two
    await bring(few, site, 1)
    await bring(many, site, 9)
    without = [await received(stand, sealed=False, backlog=backlog) for stand in two]
    assert without[0] == without[1]
    assert {each[0] for each in without[0]} >= {"lagging", "layout", "frame"}
    if backlog == 12:  # a client with the scope moves on past other messages in the two
        known = [await received(stand, sealed=True, backlog=20) for stand in two]
        assert known[0] != known[1]
