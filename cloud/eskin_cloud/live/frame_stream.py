"""One stream of frames, events and contacts: messages of a WebSocket."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from eskin_cloud.live.frame_selection import FrameSelection, StretchFilter

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, Callable, Iterator, Sequence

    from eskin_cloud.live.contacts import LiveContacts
    from eskin_cloud.live.feed import Feed
    from eskin_cloud.store.feed_entry import FeedEntry

_AT_ONCE: Final = 64
"""Entries of a client that reads what it missed."""
_PENDING: Final = 512
"""Entries among which the newest are sought for a client that reads what comes."""
_SENT_AT_ONCE: Final = 16
"""Messages that are sent before newer entries count."""


class FrameStream:
    """What one client is sent.

    It holds no queue: it reads the feed by cursor, when there is room for more. What the client
    missed before the stream began is sent in full; after that, of frames that wait too long, whole
    stretches are dropped, oldest first. Events are never dropped.

    Args:
        feed: Where it is read.
        contacts: Those of the skins whose nodes the client selects by name.
        cursor: Where to begin.
        backlog: How far behind it may be; beyond, it moves on.
        heartbeat: Seconds between signs of life.
        reveal: What an entry looks like to the client; empty if it is not shown.
        sealed: Whether the client may know when something sealed comes; else nothing that is sent,
            cursors included, depends on it.

    Attributes:
        selection: What is sent; it may change at any time.
    """

    def __init__(
        self,
        feed: Feed,
        contacts: LiveContacts,
        *,
        selection: FrameSelection,
        cursor: int,
        backlog: int,
        heartbeat: float,
        reveal: Callable[[FeedEntry], Sequence[FeedEntry]],
        sealed: bool,
    ) -> None:
        self.selection = selection
        self._feed = feed
        self._contacts = contacts
        self._cursor = self._place = cursor
        self._near = 0
        self._backlog = backlog
        self._heartbeat = heartbeat
        self._reveal = reveal
        self._sealed = sealed
        self._present = feed.last
        self._stretches = StretchFilter()
        self._layouts: dict[str, bytes] = {}
        self._last_contacts: dict[str, int] = {}
        self._skipped = 0

    async def messages(self) -> AsyncGenerator[bytes, None]:
        """Give messages until the feed closes; a caller asks for one when it can send it.

        Raises:
            StoreError: The store cannot be read, or erasures were not looked for in a while.
        """
        feed = self._feed
        with feed.subscribed():
            if not self._sealed:
                self._place = await feed.open_before(self._cursor)
            yield self._lagging()
            due = time.monotonic() + self._heartbeat
            while not feed.closed:
                if await self._skip_backlog():
                    yield self._lagging()
                most = _AT_ONCE if self._cursor < self._present else _PENDING
                found, end = await feed.after(self._cursor, most, sealed=self._sealed)
                await feed.layouts.load(found)
                for message in self._of_entries(found, end):
                    yield message
                for message in self._new_contacts():
                    yield message
                if time.monotonic() >= due:
                    yield self._lagging()
                    due = time.monotonic() + self._heartbeat
                await feed.wait(self._cursor, max(0.0, due - time.monotonic()))

    async def _skip_backlog(self) -> bool:
        """Move on where the client is too far behind; gives whether it was."""
        feed, last = self._feed, self._feed.last
        if last - self._cursor <= self._backlog or (not self._sealed and last <= self._near):
            return False
        resumed = last - self._backlog
        if not self._sealed:
            resumed, self._near = await feed.open_backlog(self._cursor, self._backlog)
        if resumed <= self._cursor:
            return False
        self._skipped += await feed.count_frames(self._cursor, resumed, self.selection.nodes)
        self._cursor = self._place = resumed
        return True

    def _of_entries(self, found: Sequence[FeedEntry], end: int) -> Iterator[bytes]:
        """Messages of entries, up to ``end`` or so many that newer entries may count."""
        sent = 0
        for entry in found:
            for message in self._of_entry(entry):
                yield message
                sent += 1
            self._cursor = self._place = entry.cursor
            if sent >= _SENT_AT_ONCE:
                return
        self._cursor = end
        if self._sealed:
            self._place = end
        if self._skipped:
            yield self._lagging()

    def _of_entry(self, entry: FeedEntry) -> Iterator[bytes]:
        """Messages of an entry; none where it is dropped or not asked for."""
        if entry.cursor > self._present and self.selection.nodes is not None:
            self._contacts.take(entry, self.selection.nodes)
        if not self.selection.takes(entry):
            return
        for shown in self._reveal(entry):
            if shown.frame is not None:
                yield from self._of_frame(shown)
            elif shown.event is not None:
                if self._skipped:
                    yield self._lagging()
                yield self._feed.frame_encoder.event(shown.cursor, shown.event)

    def _of_frame(self, entry: FeedEntry) -> Iterator[bytes]:
        live, write = entry.cursor > self._present, self._feed.frame_encoder
        message = write.frame(entry, self.selection, sealed=self._sealed)
        if message is None:
            return
        newest = self._feed.newest_frame(entry.node)
        if live and not self._stretches.keeps(entry, message.stretch, newest):
            self._skipped += 1
            return
        if self._skipped:
            yield self._lagging()
        if entry.layout is not None and self._layouts.get(entry.node) != entry.layout:
            self._layouts[entry.node] = entry.layout
            yield write.layout(entry.node, entry.layout)
        yield message.data

    def _lagging(self) -> bytes:
        """How many frames up to the present place were not sent since this was last stated."""
        skipped, self._skipped = self._skipped, 0
        return self._feed.frame_encoder.lagging(self._place, skipped)

    def _new_contacts(self) -> Iterator[bytes]:
        for node in self.selection.nodes or ():
            found = self._contacts.latest.get(node)
            if found is None:
                continue
            if found.cursor > self._last_contacts.get(found.node, self._present):
                self._last_contacts[found.node] = found.cursor
                if self._skipped:
                    yield self._lagging()
                yield self._feed.frame_encoder.contacts(self._place, found.node, found.text)
