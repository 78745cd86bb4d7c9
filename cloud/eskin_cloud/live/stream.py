"""One stream of server-sent events (HTML standard, section 9.2)."""

from __future__ import annotations

import asyncio
import logging
import time
from typing import TYPE_CHECKING, Final

from eskin.errors import StoreError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Sequence

    from eskin_cloud.live.entry_reader import EntryReader
    from eskin_cloud.live.feed import Feed
    from eskin_cloud.live.sse_encoder import Subscription
    from eskin_cloud.store.feed_entry import FeedEntry, FeedPosition

log = logging.getLogger(__name__)

PATIENCE_S: Final = 0.2
"""A reader that takes longer to make room for more is slow."""
PROMPT_S: Final = 0.02
"""A slow reader stays slow until there is room at once."""
PAUSE_S: Final = 0.25
"""A slow reader is sent events this seldom, and half as often after each overflow."""
LONGEST_PAUSE_S: Final = 2.0
REST_S: Final = 1.0
"""A slow reader stays slow for so long at least."""
LONGEST_REST_S: Final = 60.0
_AT_ONCE: Final = 64
_JOINED: Final = 2000


class Backpressure:
    """One reader's.

    Between us and a slow reader are buffers of others, and what fills them grows old in them. So it
    is sent less than it could take. Their room lets it look fast for an instant: after a try that
    does not hold, the next one comes after twice the time.

    Args:
        clock: Monotonic seconds.

    Attributes:
        pause: Seconds between two sends.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self.pause = 0.0
        self._clock = clock
        self._since = -LONGEST_REST_S
        self._rest = REST_S

    @property
    def slow(self) -> bool:
        """Whether it reads more slowly than there is to send."""
        return self.pause > 0

    def note(self, took: float) -> None:
        """It took so many seconds until there was room for more."""
        now = self._clock()
        lasted = now - self._since
        if took > PATIENCE_S and self.slow:
            self.pause, self._since = min(2 * self.pause, LONGEST_PAUSE_S), now
        elif took > PATIENCE_S:
            self._rest = REST_S if lasted > self._rest else min(2 * self._rest, LONGEST_REST_S)
            self.pause, self._since = PAUSE_S, now
        elif self.slow and took <= PROMPT_S and lasted >= self._rest:
            self.pause, self._since = 0.0, now


async def stream(
    feed: Feed,
    selection: Subscription,
    *,
    position: FeedPosition,
    backlog: int,
    heartbeat: float,
    reader: EntryReader,
    sealed: bool,
) -> AsyncIterator[bytes]:
    """Send what comes after a position until the feed closes.

    Where frames were compacted before they could be sent, or a key was missing, ``lagging`` comes
    before what is left.

    Args:
        feed: Where it is read.
        selection: What is sent.
        position: Where to begin.
        backlog: How far behind a stream may be; beyond, it gets ``lagging`` and moves on.
        heartbeat: Seconds between signs of life.
        reader: Reads entries for the one who asked.
        sealed: Whether the one who asked may know when something sealed comes; else nothing that is
            sent, ids included, depends on it.
    """
    present, pace = feed.last, Backpressure(time.monotonic)
    try:
        with feed.subscribed():
            place = position if sealed else await feed.open_before(position)
            near, stated = 0, position
            yield b"retry: 2000\n" + _sign(feed, place, b"connected")
            due = time.monotonic() + heartbeat
            while not feed.closed:
                if position.distance(feed.last) > backlog and (sealed or feed.last.total > near):
                    resumed = position.resume(feed.last, backlog)
                    if not sealed:
                        resumed, near = await feed.open_backlog(position, backlog)
                    if resumed != position:
                        after, position, place = place, resumed, resumed
                        yield _lagging(feed, place, after, resumed)
                begun = place
                most = _JOINED if pace.slow else _AT_ONCE
                found, position, compacted = await feed.after(position, most, sealed=sealed)
                if not stated.reaches(compacted):
                    stated = stated.advance(compacted.cursors)
                    yield _lagging(feed, place, place, place.advance(compacted.cursors))
                place = position if sealed else place.advance(entry.cursor for entry in found)
                await reader.load(found)
                data = _print(feed, found, selection, reader, (begun, place), slow=pace.slow)
                if data:
                    yield data
                    asked = time.monotonic()
                    yield b""  # goes on once there is room for more
                    if begun.reaches(present):
                        pace.note(time.monotonic() - asked)
                        await asyncio.sleep(pace.pause)
                if time.monotonic() >= due:
                    yield _sign(feed, place, b"heartbeat")
                    due = time.monotonic() + heartbeat
                await feed.wait(position, max(0.0, due - time.monotonic()))
    except StoreError as error:  # the reader reconnects, and then gets the error
        log.warning("live stream ended: reason=%s", error)


def _lagging(feed: Feed, place: FeedPosition, after: FeedPosition, resumed: FeedPosition) -> bytes:
    """States between which positions not all is sent."""
    after_id, resumed_id = map(feed.ids.write_position, (after, resumed))
    return feed.encoder.event("lagging", place, {"after": after_id, "resumed": resumed_id})


def _sign(feed: Feed, place: FeedPosition, comment: bytes) -> bytes:
    """A sign of life, and where to go on should the stream break off before the next event."""
    return b"id: %b\n: %b\n\n" % (feed.ids.write_position(place).encode(), comment)


def _print(
    feed: Feed,
    found: Sequence[FeedEntry],
    selection: Subscription,
    reader: EntryReader,
    span: tuple[FeedPosition, FeedPosition],
    *,
    slow: bool,
) -> bytes:
    """All that is selected; or its hulls, for a client that is too slow.

    What was missed before a stream began is sent in full. Where something was left out for want of
    a key, ``lagging`` comes first.
    """
    begun, end = span
    if not slow and all(entry.sealed is None for entry in found):
        return feed.encoder.page(found, selection, begun)
    chosen = _choose(found, selection, reader, begun)
    lagging = _lagging(feed, begun, begun, end) if reader.left_out() else b""
    if not slow:
        return lagging + feed.encoder.print(chosen, selection)
    if not chosen:
        return lagging
    entries = [entry for entry, _, _ in chosen]
    return lagging + feed.encoder.join(entries, selection, begun=begun, end=chosen[-1][1])


def _choose(
    found: Sequence[FeedEntry],
    selection: Subscription,
    reader: EntryReader,
    place: FeedPosition,
) -> list[tuple[FeedEntry, FeedPosition, bool]]:
    """What is sent of them, the position that each states, and whether others may get the same.

    Of several events in one message only the last states its position, so a client that breaks off
    before it is sent all of them again.
    """
    chosen: list[tuple[FeedEntry, FeedPosition, bool]] = []
    for entry in found:
        before, place = place, place.advance([entry.cursor])
        if selection.takes(entry):
            shown = reader.read(entry)
            for each in shown:
                if each is entry or selection.takes(each):
                    at = place if each is shown[-1] else before
                    chosen.append((each, at, each is entry))
    return chosen
