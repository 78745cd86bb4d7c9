"""The feed: every stream reads it at its own pace by position, so none holds a queue of its own.

The latest entries are kept in memory for all streams together, in the order in which they came; a
stream that is further behind reads the store, and one that is too far behind is sent what it
misses. Entries of one node are in their order; entries of different slots are in any.
"""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from sqlalchemy import func, select, union_all

from eskin.errors import MessageError
from eskin.privacy import SealedMessage
from eskin.wire.slot import SLOTS, slot_of_cursor
from eskin_cloud.live.frame_encoder import FrameEncoder
from eskin_cloud.live.layouts import Layouts
from eskin_cloud.live.sse_encoder import SseEncoder
from eskin_cloud.query.opaque_ids import OpaqueIds
from eskin_cloud.store.damage import FrameHeader, is_intact_row
from eskin_cloud.store.feed_entry import (
    FEED_START,
    FeedEntry,
    compacted_position,
    last_position,
    share,
)
from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.schema.node_key import of_nodes
from eskin_cloud.store.schema.sealed_tables import sealed_messages
from eskin_cloud.store.schema.tables import events

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence
    from concurrent.futures import Future

    from sqlalchemy import ColumnElement, Connection, Table

    from eskin_cloud.store import Store
    from eskin_cloud.store.feed_entry import FeedPosition, FeedSpan
    from eskin_cloud.store.write.ingest import IngestResult


class FeedPage(NamedTuple):
    """Entries after a position.

    Attributes:
        entries: The entries.
        end: The position up to which these are all.
        compacted: The position up to which frames may be missing, as they were compacted or
            removed; the start in the slots in which none is.
    """

    entries: Sequence[FeedEntry]
    end: FeedPosition
    compacted: FeedPosition


class Feed:
    """What was stored, slot by slot in the order of its cursors.

    Args:
        store: Holds what memory does not.
        recent: How many entries are kept in memory.
        recent_bytes: Their bytes, at most.

    Attributes:
        ids: Writes and reads positions.
        layouts: Those of the frames that streams send.
        encoder: Writes entries for all streams of server-sent events.
        frame_encoder: Writes entries for all streams of frames.
        closed: Whether streams should end.
        subscribers: How many streams there are.
    """

    def __init__(self, store: Store, *, recent: int, recent_bytes: int) -> None:
        self._store = store
        self._most = recent
        self._most_bytes = recent_bytes
        self._used = 0
        with store.read() as connection:
            self._last = self._floor = last_position(connection)
        self.ids = OpaqueIds(store.cursor_key)
        self._recent: deque[FeedEntry] = deque()
        self._news = asyncio.Event()
        self._newest_frames: dict[str, int] = {}
        self.layouts = Layouts(store)
        self.encoder = SseEncoder(self.ids, self.layouts)
        self.frame_encoder = FrameEncoder(self.ids, self.layouts)
        self.closed = False
        self.subscribers = 0

    @property
    def last(self) -> FeedPosition:
        """The latest position."""
        return self._last

    def follow(self, future: Future[IngestResult], loop: asyncio.AbstractEventLoop) -> None:
        """Take over a write's entries once it is durable; in the order of commits."""

        def committed(done: Future[IngestResult]) -> None:
            if not done.cancelled() and done.exception() is None and not loop.is_closed():
                loop.call_soon_threadsafe(self.append, done.result().entries)

        future.add_done_callback(committed)

    def append(self, entries: Sequence[FeedEntry]) -> None:
        """Add entries and wake all streams; on the event loop only."""
        fresh = [entry for entry in entries if entry.cursor not in self._last]
        reached, gaps = dict[int, int](), dict[int, int]()
        for entry in fresh:
            slot = slot_of_cursor(entry.cursor)
            if entry.cursor != reached.get(slot, self._last.cursors[slot]) + SLOTS:
                gaps[slot] = entry.cursor  # another process stored what lies between
            reached[slot] = entry.cursor
        if gaps:
            self._leave_to_store(self._last.advance(reached[slot] for slot in gaps))
            fresh = [entry for entry in fresh if slot_of_cursor(entry.cursor) not in gaps]
        if not reached:
            return
        self._recent.extend(fresh)
        self._used += sum(entry.size for entry in fresh)
        self._last = self._last.advance(reached.values())
        self._note_frames(fresh)
        forgotten: list[int] = []
        while len(self._recent) > self._most or self._used > self._most_bytes:
            oldest = self._recent.popleft()
            self._used -= oldest.size
            forgotten.append(oldest.cursor)
        self._floor = self._floor.advance(forgotten)
        self.wake()

    def advance(self, position: FeedPosition) -> None:
        """Have streams read the store up to a position: another process stored some of it."""
        if not self._last.reaches(position):
            self._leave_to_store(position)
            self.wake()

    def _leave_to_store(self, position: FeedPosition) -> None:
        """Read nothing from memory of the slots in which a position is later than the last one.

        Their entries lie below the floor now, so no stream gets them, and go as all that is old.
        """
        spans = list(self._last.spans(position))
        self._last = self._last.advance(span.end for span in spans)
        self._floor = self._floor.advance(span.end for span in spans)

    async def catch_up(self) -> None:
        """Go on to what is stored by now, by any process.

        Raises:
            StoreError: The store cannot be read.
        """

        def look() -> FeedPosition:
            with self._store.read() as connection:
                return last_position(connection)

        self.advance(await asyncio.to_thread(look))

    @contextmanager
    def subscribed(self) -> Iterator[None]:
        """Count a stream while it is open."""
        self.subscribers += 1
        try:
            yield
        finally:
            self.subscribers -= 1

    def close(self) -> None:
        """Have all streams end."""
        self.closed = True
        self.wake()

    def newest_frame(self, node: str) -> int:
        """When the newest frame of a node was stored that this process knows of, UTC ns."""
        return self._newest_frames.get(node, 0)

    def _note_frames(self, entries: Iterable[FeedEntry]) -> None:
        newest = self._newest_frames
        for entry in entries:
            if entry.frame is not None:
                newest[entry.node] = max(entry.received, newest.get(entry.node, 0))

    def wake(self) -> None:
        """Have all streams look whether there is something for them."""
        self._news.set()
        self._news = asyncio.Event()

    async def wait(self, position: FeedPosition, seconds: float) -> bool:
        """Wait for something after a position; gives whether there is."""
        news = self._news
        if self._last != position or self.closed:
            return True
        try:
            # Not `asyncio.wait_for`, which makes a task each time: many wait here.
            async with asyncio.timeout(seconds):
                await news.wait()
        except TimeoutError:
            return False
        return True

    async def after(self, position: FeedPosition, most: int, *, sealed: bool = True) -> FeedPage:
        """Entries after a position.

        Args:
            position: At most the last one.
            most: How many.
            sealed: Whether sealed ones count, and are given; else nothing depends on them.
        """
        if not position.reaches(self._floor):
            read = partial(self._read, position, self._floor, most, sealed=sealed)
            page = await asyncio.to_thread(read)
            self._note_frames(page.entries)
            return page
        newer = self._newer(position)
        if len(newer) <= most:
            shown = [entry for entry in newer if sealed or entry.sealed is None]
            return FeedPage(shown, self._last, FEED_START)
        taken: list[FeedEntry] = []
        passed: list[int] = []
        for entry in newer:
            if sealed or entry.sealed is None:
                taken.append(entry)
            passed.append(entry.cursor)
            if len(taken) == most:
                break
        return FeedPage(taken, position.advance(passed), FEED_START)

    def _newer(self, position: FeedPosition) -> list[FeedEntry]:
        """What memory holds after a position, oldest first."""
        missing = position.distance(self._last)
        newer: list[FeedEntry] = []
        for entry in reversed(self._recent):
            if len(newer) == missing:
                break
            if entry.cursor not in position:
                newer.append(entry)
        return newer[::-1]

    async def count_frames(
        self, after: FeedPosition, end: FeedPosition, nodes: Collection[str] | None
    ) -> int | None:
        """How many frames are between two positions, of some nodes or of all.

        Returns:
            ``None`` if some were compacted or removed.
        """

        def look() -> int | None:
            total, spans = 0, list(after.spans(end))
            with self._store.read() as connection:
                for span in spans:
                    query = select(func.count()).where(*_within(frames, span))
                    if nodes is not None:
                        query = query.where(of_nodes(frames, nodes))
                    total += connection.execute(query).scalar_one()
                whole = compacted_position(connection, spans) == FEED_START
            return total if whole else None

        return await asyncio.to_thread(look)

    async def open_before(self, position: FeedPosition) -> FeedPosition:
        """The latest position up to another one, or at it, that depends on nothing sealed."""

        def look() -> FeedPosition:
            spans = list(FEED_START.spans(position))
            if not spans:
                return FEED_START
            latest = [
                select(func.max(table.c.cursor)).where(*_within(table, span))
                for span in spans
                for table in (events, frames)
            ]
            with self._store.read() as connection:
                found = connection.execute(union_all(*latest)).scalars().all()
            return FEED_START.advance(cursor for cursor in found if cursor is not None)

        return await asyncio.to_thread(look)

    async def open_backlog(self, position: FeedPosition, most: int) -> tuple[FeedPosition, int]:
        """Where a stream goes on that is behind by more than ``most`` entries that are not sealed.

        Returns:
            The position, the same if it is not so far behind; and the total (`FeedPosition.total`)
            up to which it cannot be.
        """

        def look() -> tuple[FeedPosition, int]:
            with self._store.read() as connection:
                last = last_position(connection)
                latest = [
                    _open_cursors(connection, span, most + 1, latest=True)
                    for span in position.spans(last)
                ]
            sizes = list(map(len, latest))
            if sum(sizes) <= most:
                return position, last.total + most - sum(sizes)
            kept = zip(latest, share(most, sizes), strict=True)
            passed = (cursors[size] for cursors, size in kept if size < len(cursors))
            return position.advance(passed), last.total

        return await asyncio.to_thread(look)

    def _read(
        self, position: FeedPosition, end: FeedPosition, most: int, *, sealed: bool
    ) -> FeedPage:
        """Read some of what the store holds between two positions: of each slot its first ones."""
        spans = list(position.spans(end))
        shares = share(max(most, len(spans)), [span.size for span in spans])
        chosen: list[FeedSpan] = []
        with self._store.read() as connection:
            for span, size in zip(spans, shares, strict=True):
                last = min(span.end, span.after + size * SLOTS)
                if not sealed:
                    places = _open_cursors(connection, span, size, latest=False)
                    last = places[-1] if len(places) == size else span.end
                chosen.append(span._replace(end=last))
            found = read_entries(connection, chosen)
            compacted = compacted_position(connection, chosen)
        reached = position.advance(span.end for span in chosen)
        shown = [entry for entry in found if sealed or entry.sealed is None]
        return FeedPage(shown, reached, compacted)


def _within(table: Table, span: FeedSpan) -> tuple[ColumnElement[bool], ...]:
    c = table.c
    return c.slot == span.slot, c.cursor > span.after, c.cursor <= span.end


def _open_cursors(connection: Connection, span: FeedSpan, most: int, *, latest: bool) -> list[int]:
    """The first or latest cursors of what is not sealed, in that order."""
    found: list[int] = []
    for table in (events, frames):
        cursor = table.c.cursor
        query = select(cursor).where(*_within(table, span))
        query = query.order_by(cursor.desc() if latest else cursor).limit(most)
        found += connection.execute(query).scalars()
    return sorted(found, reverse=latest)[:most]


def read_entries(connection: Connection, spans: Iterable[FeedSpan]) -> list[FeedEntry]:
    """The entries of spans, in the order of their slots, then of their cursors."""
    return [entry for span in spans for entry in _read_span(connection, span)]


def _read_span(connection: Connection, span: FeedSpan) -> list[FeedEntry]:
    rows = connection.execute(select(events).where(*_within(events, span))).mappings()
    found = [
        FeedEntry(row["cursor"], row["node"], row["channel"], dict(row), row["received"])
        for row in intact_rows(connection, events, rows)
    ]
    framed = select(frames).where(*_within(frames, span))
    found += [
        FeedEntry(row["cursor"], row["node"], None, None, row["received"],
                  frame=row["data"], layout=row["layout"])
        for row in connection.execute(framed).mappings()
        if is_intact_row(FrameHeader, row)
    ]  # fmt: skip
    v = sealed_messages.c
    sealed = select(v.cursor, v.node, v.data, v.received)
    for cursor, node, data, received in connection.execute(
        sealed.where(*_within(sealed_messages, span))
    ):
        try:
            message = SealedMessage.decode(data)
        except MessageError:  # damaged
            continue
        head = cursor, node, None, None, received, data
        found.append(FeedEntry(*head, layout=message.layout))
    return sorted(found, key=lambda entry: entry.cursor)
