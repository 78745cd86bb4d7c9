"""The feed: every stream reads it at its own pace by cursor, so none holds a queue of its own.

The latest entries are kept in memory for all streams together; a stream that is further behind
reads the store, and one that is too far behind is sent what it misses.
"""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import contextmanager
from itertools import takewhile
from typing import TYPE_CHECKING

from sqlalchemy import func, select

from eskin.errors import MessageError
from eskin.privacy import SealedMessage
from eskin_cloud.live.frame_encoder import FrameEncoder
from eskin_cloud.live.layouts import Layouts
from eskin_cloud.live.sse_encoder import SseEncoder
from eskin_cloud.query.opaque_ids import OpaqueIds
from eskin_cloud.store.damage import FrameHeader, is_intact_row
from eskin_cloud.store.feed_entry import FeedEntry
from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.schema.sealed_tables import sealed_messages
from eskin_cloud.store.schema.tables import events, feed

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence
    from concurrent.futures import Future

    from sqlalchemy import Connection

    from eskin_cloud.store import Store
    from eskin_cloud.store.write.ingest import IngestResult


class Feed:
    """What was stored, in order of its cursor.

    Args:
        store: Holds what memory does not.
        recent: How many entries are kept in memory.
        recent_bytes: Their bytes, at most.

    Attributes:
        ids: Writes and reads cursors.
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
            self._last = self._floor = last_cursor(connection)
            self.ids = OpaqueIds.of(connection)
        self._recent: deque[FeedEntry] = deque()
        self._news = asyncio.Event()
        self._newest_frames: dict[str, int] = {}
        self.layouts = Layouts(store)
        self.encoder = SseEncoder(self.ids, self.layouts)
        self.frame_encoder = FrameEncoder(self.ids, self.layouts)
        self.closed = False
        self.subscribers = 0

    @property
    def last(self) -> int:
        """The latest cursor."""
        return self._last

    def follow(self, future: Future[IngestResult], loop: asyncio.AbstractEventLoop) -> None:
        """Take over a write's entries once it is durable; in the order of commits."""

        def committed(done: Future[IngestResult]) -> None:
            if not done.cancelled() and done.exception() is None and not loop.is_closed():
                loop.call_soon_threadsafe(self.append, done.result().entries)

        future.add_done_callback(committed)

    def append(self, entries: Sequence[FeedEntry]) -> None:
        """Add entries and wake all streams; on the event loop only."""
        fresh = [entry for entry in entries if entry.cursor > self._last]
        if not fresh:
            return
        if fresh[0].cursor != self._last + 1:  # another process stored what lies between
            self.advance(fresh[-1].cursor)
            return
        self._recent.extend(fresh)
        self._used += sum(entry.size for entry in fresh)
        self._last = fresh[-1].cursor
        self._note_frames(fresh)
        while len(self._recent) > self._most or self._used > self._most_bytes:
            oldest = self._recent.popleft()
            self._used -= oldest.size
            self._floor = oldest.cursor
        self.wake()

    def advance(self, cursor: int) -> None:
        """Have streams read the store up to a cursor: another process stored some of it."""
        if cursor > self._last:
            self._recent.clear()
            self._used = 0
            self._last = self._floor = cursor
            self.wake()

    async def catch_up(self) -> None:
        """Go on to what is stored by now, by any process.

        Raises:
            StoreError: The store cannot be read.
        """

        def look() -> int:
            with self._store.read() as connection:
                return last_cursor(connection)

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

    async def wait(self, cursor: int, seconds: float) -> bool:
        """Wait for something after a cursor; gives whether there is."""
        news = self._news
        if self._last > cursor or self.closed:
            return True
        try:
            # Not `asyncio.wait_for`, which makes a task each time: many wait here.
            async with asyncio.timeout(seconds):
                await news.wait()
        except TimeoutError:
            return False
        return True

    async def after(
        self, cursor: int, most: int, *, sealed: bool = True
    ) -> tuple[Sequence[FeedEntry], int]:
        """Entries after a cursor, and the cursor up to which these are all.

        Args:
            cursor: The place.
            most: How many.
            sealed: Whether sealed ones count, and are given; else nothing depends on them.
        """
        found: Sequence[FeedEntry]
        if cursor >= self._floor:
            newer = takewhile(lambda entry: entry.cursor > cursor, reversed(self._recent))
            found = [entry for entry in newer if sealed or entry.sealed is None][: -most - 1 : -1]
            return found, found[-1].cursor if found else self._last
        if sealed:
            end = min(cursor + most, self._floor)
            found = await asyncio.to_thread(self._read, cursor, end)
        else:
            found, end = await asyncio.to_thread(self._read_open, cursor, most)
        self._note_frames(found)
        return found, end

    async def count_frames(self, after: int, end: int, nodes: Collection[str] | None) -> int:
        """How many frames are in ``(after, end]``, of some nodes or of all."""

        def look() -> int:
            c = frames.c
            query = select(func.count()).where(c.cursor > after, c.cursor <= end)
            if nodes is not None:
                query = query.where(c.node.in_(nodes))
            with self._store.read() as connection:
                return connection.execute(query).scalar_one()

        return await asyncio.to_thread(look)

    async def open_before(self, cursor: int) -> int:
        """The latest place up to a cursor, or at it, of something that is not sealed."""

        def look() -> int:
            with self._store.read() as connection:
                return max((_open_places(connection, 0, cursor, 1)), default=0)

        return await asyncio.to_thread(look)

    async def open_backlog(self, cursor: int, most: int) -> tuple[int, int]:
        """Where a stream goes on that is behind by more than ``most`` entries that are not sealed.

        Returns:
            The cursor, the same if it is not so far behind; and the last place up to which it
            cannot be.
        """

        def look() -> tuple[int, int]:
            with self._store.read() as connection:
                last = last_cursor(connection)
                places = _open_places(connection, cursor, last, most + 1)
            if len(places) > most:
                return places[-1], last
            return cursor, last + most - len(places)

        return await asyncio.to_thread(look)

    def _read_open(self, cursor: int, most: int) -> tuple[Sequence[FeedEntry], int]:
        with self._store.read() as connection:
            places = _open_places(connection, cursor, self._floor, most, latest=False)
            end = places[-1] if len(places) == most else max(self._floor, cursor)
            found = read_entries(connection, cursor, end)
        return [entry for entry in found if entry.sealed is None], end

    def _read(self, cursor: int, end: int) -> Sequence[FeedEntry]:
        with self._store.read() as connection:
            return read_entries(connection, cursor, end)


def last_cursor(connection: Connection) -> int:
    """The latest place in the feed."""
    return int(connection.execute(select(feed.c.cursor)).scalar_one())


def _open_places(
    connection: Connection, after: int, end: int, most: int, *, latest: bool = True
) -> list[int]:
    """The first or latest places in ``(after, end]`` of what is not sealed, in that order."""
    places: list[int] = []
    for column in (events.c.cursor, frames.c.cursor):
        query = select(column).where(column > after, column <= end)
        query = query.order_by(column.desc() if latest else column).limit(most)
        places += connection.execute(query).scalars()
    return sorted(places, reverse=latest)[:most]


def read_entries(connection: Connection, after: int, end: int) -> Sequence[FeedEntry]:
    """Entries with ``after < cursor <= end``."""
    e = events.c
    named = connection.execute(select(events).where(e.cursor > after, e.cursor <= end)).mappings()
    found = [
        FeedEntry(row["cursor"], row["node"], row["channel"], dict(row), row["received"])
        for row in intact_rows(connection, events, named)
    ]
    f = frames.c
    framed = select(frames).where(f.cursor > after, f.cursor <= end)
    found += [
        FeedEntry(row["cursor"], row["node"], None, None, row["received"],
                  frame=row["data"], layout=row["layout"])
        for row in connection.execute(framed).mappings()
        if is_intact_row(FrameHeader, row)
    ]  # fmt: skip
    v = sealed_messages.c
    sealed = select(v.cursor, v.node, v.data, v.received)
    for cursor, node, data, received in connection.execute(
        sealed.where(v.cursor > after, v.cursor <= end)
    ):
        try:
            message = SealedMessage.decode(data)
        except MessageError:  # damaged
            continue
        head = cursor, node, None, None, received, data
        found.append(FeedEntry(*head, layout=message.layout))
    return sorted(found, key=lambda entry: entry.cursor)
