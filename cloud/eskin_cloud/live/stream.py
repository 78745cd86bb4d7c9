"""One stream of server-sent events (HTML standard, section 9.2)."""

from __future__ import annotations

import asyncio
import logging
import time
from typing import TYPE_CHECKING, Final

from eskin.errors import StoreError
from eskin_cloud.live.backpressure import Backpressure

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Sequence

    from eskin_cloud.live.feed import Feed
    from eskin_cloud.live.subscription import Subscription
    from eskin_cloud.store.feed_entry import FeedEntry

log = logging.getLogger(__name__)

_AT_ONCE: Final = 64
_JOINED: Final = 2000


async def stream(
    feed: Feed,
    selection: Subscription,
    *,
    cursor: int,
    backlog: int,
    heartbeat: float,
    reveal: Callable[[FeedEntry], Sequence[FeedEntry]],
    sealed: bool,
) -> AsyncIterator[bytes]:
    """Tell what comes after a cursor until the feed closes.

    Args:
        feed: Where it is read.
        selection: What is sent.
        cursor: Where to begin.
        backlog: How far behind a stream may be; beyond, it gets ``lagging`` and moves on.
        heartbeat: Seconds between signs of life.
        reveal: What an entry looks like to the one who asked; empty if it is not shown.
        sealed: Whether the one who asked may know when something sealed comes; else nothing that is
            sent, ids included, depends on it.
    """
    present, pace = feed.last, Backpressure(time.monotonic)
    try:
        with feed.subscribed():
            place = cursor if sealed else await feed.open_before(cursor)
            near = 0
            yield b"retry: 2000\n" + _sign(feed, place, b"connected")
            due = time.monotonic() + heartbeat
            while not feed.closed:
                if feed.last - cursor > backlog and (sealed or feed.last > near):
                    resumed = feed.last - backlog
                    if not sealed:
                        resumed, near = await feed.open_backlog(cursor, backlog)
                    if resumed > cursor:
                        ids = {"after": feed.ids.write(place), "resumed": feed.ids.write(resumed)}
                        cursor = place = resumed
                        yield feed.encoder.event("lagging", cursor, ids)
                begun = place
                most = _JOINED if pace.slow else _AT_ONCE
                found, cursor = await feed.after(cursor, most, sealed=sealed)
                place = cursor if sealed else found[-1].cursor if found else place
                await feed.layouts.load(found)
                said = _print(feed, found, selection, reveal, begun if pace.slow else None)
                if said:
                    yield said
                    asked = time.monotonic()
                    yield b""  # goes on once there is room for more
                    if begun >= present:
                        pace.note(time.monotonic() - asked)
                        await asyncio.sleep(pace.pause)
                if time.monotonic() >= due:
                    yield _sign(feed, place, b"heartbeat")
                    due = time.monotonic() + heartbeat
                await feed.wait(cursor, max(0.0, due - time.monotonic()))
    except StoreError as error:  # the reader reconnects, and then gets the error
        log.warning("live stream ended: reason=%s", error)


def _sign(feed: Feed, cursor: int, said: bytes) -> bytes:
    """A sign of life, and where to go on should the stream break off before the next event."""
    return b"id: %b\n: %b\n\n" % (feed.ids.write(cursor).encode(), said)


def _print(
    feed: Feed,
    found: Sequence[FeedEntry],
    selection: Subscription,
    reveal: Callable[[FeedEntry], Sequence[FeedEntry]],
    slow_since: int | None,
) -> bytes:
    """All that is selected; or its hulls, for a reader that is too slow.

    What was missed before a stream began is sent in full.
    """
    if slow_since is None and all(entry.sealed is None for entry in found):
        return feed.encoder.page(found, selection)
    said = _choose(found, selection, reveal)
    if slow_since is None:
        return feed.encoder.print(said, selection)
    entries = [entry for entry, _ in said]
    return feed.encoder.join(entries, slow_since, selection) if said else b""


def _choose(
    found: Sequence[FeedEntry],
    selection: Subscription,
    reveal: Callable[[FeedEntry], Sequence[FeedEntry]],
) -> list[tuple[FeedEntry, bool]]:
    """What is sent of them, and whether other readers may get the same."""
    return [
        (said, said is entry)
        for entry in found
        if selection.takes(entry)
        for said in reveal(entry)
        if said is entry or selection.takes(said)
    ]
