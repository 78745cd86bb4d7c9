"""Live streams as tests read them."""

from __future__ import annotations

import asyncio
import json
from typing import TYPE_CHECKING, Any

from eskin_cloud.live.entry_reader import EntryReader
from eskin_cloud.live.sse_encoder import Subscription
from eskin_cloud.live.stream import stream

from tests.unit.cloud.clouds import position

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from eskin_cloud.access import Scope
    from eskin_cloud.store.feed_entry import FeedPosition

    from tests.unit.cloud.clouds import Stand

EVERYTHING = Subscription(frozenset(), frozenset())


def parse(piece: bytes) -> dict[str, Any]:
    """One event of a stream; a comment becomes ``comment``."""
    found: dict[str, Any] = {}
    for line in piece.decode().strip().split("\n"):
        name, _, value = line.partition(": ")
        found[name or "comment"] = value
    if "data" in found:
        found["data"] = json.loads(found["data"])
    return found


def events_of(piece: bytes) -> list[dict[str, Any]]:
    """The events of a piece of a stream, without comments."""
    parsed = [parse(one) for one in piece.split(b"\n\n") if one]
    return [event for event in parsed if "event" in event]


def entry_reader(stand: Stand, *scopes: Scope) -> EntryReader:
    """What reads entries for a caller with some scopes."""
    cloud = stand.cloud
    return EntryReader(cloud.key_access, scopes, cloud.feed.layouts, cloud.store)


def listen(
    stand: Stand,
    cursor: int | FeedPosition = 0,
    selection: Subscription = EVERYTHING,
    **options: Any,
) -> AsyncIterator[bytes]:
    """A stream on a cloud's feed, after so many entries of the usual node, or a position."""
    chosen: dict[str, Any] = {"backlog": 1000, "heartbeat": 30.0}
    chosen["reader"] = entry_reader(stand)
    chosen["sealed"] = True
    chosen |= options
    begin = position(cursor) if isinstance(cursor, int) else cursor
    return stream(stand.cloud.feed, selection, position=begin, **chosen)


async def take(stand: Stand, count: int, **options: Any) -> list[dict[str, Any]]:
    """The first events of a stream, after its greeting."""
    found: list[dict[str, Any]] = []
    async with asyncio.timeout(20):
        async for piece in listen(stand, **options):
            found += events_of(piece)
            if len(found) >= count:
                return found[:count]
    return found
