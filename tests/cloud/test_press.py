"""What many are told alike is printed once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from cloud.live.selection import Selection
from tests.cloud.clouds import batch
from tests.cloud.messages import block, peak
from tests.cloud.streams import EVERYTHING, events_of

if TYPE_CHECKING:
    from tests.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


async def test_those_who_look_on_alike_are_told_the_same_bytes(stand: Stand) -> None:
    await stand.ingest(batch(block(0), peak(1), block(2)))
    feed = stand.cloud.feed
    found, _ = await feed.after(0, 64)
    first = feed.press.page(found, EVERYTHING)
    assert feed.press.page(list(found), Selection(frozenset(), frozenset(), 50)) is first
    assert [event["event"] for event in events_of(first)] == ["block", "peak", "block"]
    elsewhere = Selection(frozenset({"palm"}), frozenset(), 50)
    assert feed.press.page(found, elsewhere) == b""
    assert [event["id"] for event in events_of(feed.press.page(found[1:], EVERYTHING))] == [
        "2",
        "3",
    ]
    for points in range(1, 100):
        feed.press.page(found, Selection(frozenset(), frozenset(), points))
    assert len(feed.press._pages) <= 16
