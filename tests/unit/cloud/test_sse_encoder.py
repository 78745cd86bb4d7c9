"""What many are stated alike is printed once."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.live.sse_encoder import Subscription
from eskin_cloud.store.feed_entry import FEED_START

from tests.unit.cloud.clouds import batch, position
from tests.unit.cloud.messages import peak, stretch
from tests.unit.cloud.streams import EVERYTHING, events_of

if TYPE_CHECKING:
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


async def test_viewers_of_the_same_get_the_same_bytes(stand: Stand) -> None:
    await stand.ingest(batch(stretch(0), peak(1), stretch(2)))
    feed = stand.cloud.feed
    found = (await feed.after(FEED_START, 64)).entries
    await feed.layouts.load(found)
    begun = FEED_START
    first = feed.encoder.page(found, EVERYTHING, begun)
    assert feed.encoder.page(list(found), replace(EVERYTHING), replace(begun)) is first
    assert [event["event"] for event in events_of(first)] == ["frame", "peak", "frame"]
    elsewhere = Subscription(frozenset({"palm"}), frozenset(), 50)
    assert feed.encoder.page(found, elsewhere, begun) == b""
    rest = feed.encoder.page(found[1:], EVERYTHING, position(1))
    assert [event["id"] for event in events_of(rest)] == ["2", "3"]
    for points in range(1, 100):
        feed.encoder.page(found, Subscription(frozenset(), frozenset(), points), begun)
    assert len(feed.encoder._pages) <= 16
