"""One stream of frames, events and contacts: messages of a WebSocket."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from eskin_cloud.live.frame_encoder import FrameSelection, StretchFilter

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, Iterator, Sequence

    from eskin_cloud.live.contacts import LiveContacts
    from eskin_cloud.live.entry_reader import EntryReader
    from eskin_cloud.live.feed import Feed
    from eskin_cloud.store.feed_entry import FeedEntry, FeedPosition

_AT_ONCE: Final = 64
"""Entries of a client that reads what it missed."""
_PENDING: Final = 512
"""Entries among which the newest are sought for a client that reads what comes."""
_SENT_AT_ONCE: Final = 16
"""Messages that are sent before newer entries count."""


class FrameStream:
    """What one client is sent.

    It holds no queue: it reads the feed by position, when there is room for more. What the client
    missed before the stream began is sent in full, but for frames that were compacted; after that,
    of frames that wait too long, whole stretches are dropped, oldest first. Events are never
    dropped.

    Args:
        feed: Where it is read.
        contacts: Those of the skins whose nodes the client selects by name.
        position: Where to begin.
        backlog: How far behind it may be; beyond, it moves on.
        heartbeat: Seconds between signs of life.
        reader: Reads entries for the client.
        sealed: Whether the client may know when something sealed comes; else nothing that is sent,
            positions included, depends on it.

    Attributes:
        selection: What is sent; it may change at any time.
    """

    def __init__(
        self,
        feed: Feed,
        contacts: LiveContacts,
        *,
        selection: FrameSelection,
        position: FeedPosition,
        backlog: int,
        heartbeat: float,
        reader: EntryReader,
        sealed: bool,
    ) -> None:
        self.selection = selection
        self._feed = feed
        self._contacts = contacts
        self._position = self._place = self._stated = position
        self._near = 0
        self._backlog = backlog
        self._heartbeat = heartbeat
        self._reader = reader
        self._sealed = sealed
        self._present = feed.last
        self._stretches = StretchFilter()
        self._layouts: dict[str, bytes] = {}
        self._found_before = contacts.found
        self._last_contacts: dict[str, int] = {}
        self._skipped: int | None = 0

    async def messages(self) -> AsyncGenerator[bytes, None]:
        """Give messages until the feed closes; a caller asks for one when it can send it.

        Raises:
            StoreError: The store cannot be read, or erasures were not looked for in a while.
        """
        feed = self._feed
        with feed.subscribed():
            if not self._sealed:
                self._place = await feed.open_before(self._position)
            yield self._lagging()
            due = time.monotonic() + self._heartbeat
            while not feed.closed:
                if await self._skip_backlog():
                    yield self._lagging()
                present = self._position.reaches(self._present)
                most = _PENDING if present else _AT_ONCE
                found, end, compacted = await feed.after(self._position, most, sealed=self._sealed)
                if not self._stated.reaches(compacted):
                    self._stated = self._stated.advance(compacted.cursors)
                    self._skip(None)
                    yield self._lagging()
                await self._reader.load(found)
                for message in self._of_entries(found, end):
                    yield message
                for message in self._new_contacts():
                    yield message
                if time.monotonic() >= due:
                    yield self._lagging()
                    due = time.monotonic() + self._heartbeat
                await feed.wait(self._position, max(0.0, due - time.monotonic()))

    async def _skip_backlog(self) -> bool:
        """Move on where the client is too far behind; gives whether it was."""
        feed, last = self._feed, self._feed.last
        if self._position.distance(last) <= self._backlog:
            return False
        if not self._sealed and last.total <= self._near:
            return False
        resumed = self._position.resume(last, self._backlog)
        if not self._sealed:
            resumed, self._near = await feed.open_backlog(self._position, self._backlog)
        if resumed == self._position:
            return False
        self._skip(await feed.count_frames(self._position, resumed, self.selection.nodes))
        self._position = self._place = resumed
        return True

    def _of_entries(self, found: Sequence[FeedEntry], end: FeedPosition) -> Iterator[bytes]:
        """Messages of entries, up to ``end`` or so many that newer entries may count."""
        sent = 0
        for entry in found:
            place = self._place.advance([entry.cursor])
            for message in self._of_entry(entry, place):
                yield message
                sent += 1
            self._position, self._place = self._position.advance([entry.cursor]), place
            if sent >= _SENT_AT_ONCE:
                return
        self._position = end
        if self._sealed:
            self._place = end
        if self._skipped != 0:
            yield self._lagging()

    def _of_entry(self, entry: FeedEntry, place: FeedPosition) -> Iterator[bytes]:
        """Messages of an entry, up to a position; none where it is dropped or not asked for."""
        if entry.cursor not in self._present and self.selection.nodes is not None:
            self._contacts.take(entry, self.selection.nodes)
        if not self.selection.takes(entry):
            return
        revealed = self._reader.read(entry)
        if self._reader.left_out():
            self._skip(None)
        for shown in revealed:
            if shown.frame is not None:
                yield from self._of_frame(shown, place)
            elif shown.event is not None:
                if self._skipped != 0:
                    yield self._lagging()
                # A client that breaks off before the last one is sent all again.
                at = place if shown is revealed[-1] else self._place
                yield self._feed.frame_encoder.event(at, shown.event)

    def _of_frame(self, entry: FeedEntry, place: FeedPosition) -> Iterator[bytes]:
        live, write = entry.cursor not in self._present, self._feed.frame_encoder
        message = write.frame(entry, self.selection, sealed=self._sealed)
        if message is None:
            return
        newest = self._feed.newest_frame(entry.node)
        if live and not self._stretches.keeps(entry, message.stretch, newest):
            self._skip(1)
            return
        if self._skipped != 0:
            yield self._lagging()
        if entry.layout is not None and self._layouts.get(entry.node) != entry.layout:
            self._layouts[entry.node] = entry.layout
            yield write.layout(entry.node, entry.layout)
        yield write.state(message, place)

    def _skip(self, frames: int | None) -> None:
        """Count frames that are not sent; ``None`` where their number is not known."""
        before = self._skipped
        self._skipped = None if before is None or frames is None else before + frames

    def _lagging(self) -> bytes:
        """How many frames up to the present place were not sent since this was last stated."""
        skipped, self._skipped = self._skipped, 0
        return self._feed.frame_encoder.lagging(self._place, skipped)

    def _new_contacts(self) -> Iterator[bytes]:
        for node in self.selection.nodes or ():
            found = self._contacts.latest.get(node)
            if found is None:
                continue
            if found.number > self._last_contacts.get(found.node, self._found_before):
                self._last_contacts[found.node] = found.number
                if self._skipped != 0:
                    yield self._lagging()
                yield self._feed.frame_encoder.contacts(self._place, found.node, found.text)
