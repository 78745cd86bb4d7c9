"""Entries of the feed as events of a stream; each is written once for all who look on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from cachetools import FIFOCache

from eskin_cloud.live.frame_hulls import describe_frames, join_frames, read_hulls
from eskin_cloud.schemas.base import dump
from eskin_cloud.schemas.events import describe_event

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin_cloud.live.layouts import Layouts
    from eskin_cloud.live.subscription import Subscription
    from eskin_cloud.query.opaque_ids import OpaqueIds
    from eskin_cloud.store.feed_entry import FeedEntry

_KEPT: Final = 512
_PAGES: Final = 16


class SseEncoder:
    """Prints entries, and keeps the latest ones for the next who asks for the same.

    What was sealed is not kept.

    Args:
        ids: Writes cursors.
        layouts: Those of the frames, loaded.
    """

    def __init__(self, ids: OpaqueIds, layouts: Layouts) -> None:
        self.ids = ids
        self._layouts = layouts
        self._frames: FIFOCache[tuple[int, frozenset[str] | None, int], bytes] = FIFOCache(_KEPT)
        self._pages: FIFOCache[tuple[int, int, Subscription], bytes] = FIFOCache(_PAGES)

    def page(self, found: Sequence[FeedEntry], selection: Subscription) -> bytes:
        """What is asked for of neighbours in the feed, of which nothing is sealed.

        Many readers select the same: their entries are encoded once.
        """
        if not found:
            return b""
        key = found[0].cursor, found[-1].cursor, selection
        page = self._pages.get(key)
        if page is None:
            said = [(entry, True) for entry in found if selection.takes(entry)]
            page = self._pages[key] = self.print(said, selection)
        return page

    def print(self, said: Sequence[tuple[FeedEntry, bool]], selection: Subscription) -> bytes:
        """Entries as events of the stream.

        Args:
            said: Each with whether others may be given the same bytes.
            selection: Which channels of frames are asked for, and how finely.
        """
        return b"".join(self._event(entry, selection, keep=keep) for entry, keep in said)

    def _event(self, entry: FeedEntry, selection: Subscription, *, keep: bool) -> bytes:
        if entry.frame is None:
            return self.of_row(entry.cursor, entry.event or {})
        key = entry.cursor, selection.channels_of(entry.node), selection.points
        if not keep:
            return self._of_frame(entry, *key[1:])
        if key not in self._frames:
            self._frames[key] = self._of_frame(entry, *key[1:])
        return self._frames[key]

    def _of_frame(self, entry: FeedEntry, channels: frozenset[str] | None, points: int) -> bytes:
        """A frame; nothing where it has none of the channels, or its layout is lost."""
        hulls = read_hulls(entry, self._layouts.get(entry.layout), channels, points)
        return b"" if hulls is None else self.event("frame", entry.cursor, describe_frames(hulls))

    def of_row(self, cursor: int, row: dict[str, Any]) -> bytes:
        """An event's row as an event of the stream."""
        return self.event(str(row["kind"]), cursor, describe_event(row, self.ids))

    def event(self, kind: str, cursor: int, data: object) -> bytes:
        """One event of a stream."""
        said = kind.encode(), self.ids.write(cursor).encode(), dump(data)
        return b"event: %b\nid: %b\ndata: %b\n\n" % said

    def join(self, entries: Sequence[FeedEntry], begun: int, selection: Subscription) -> bytes:
        """Many entries at once, for one who reads too slowly: fewer events, and wider hulls.

        Frames of a page that follow each other without a gap become one hull; all else is sent as
        it is. Only the last event carries the last entry's cursor, so a
        reader that breaks off before it is sent all of them again.

        Args:
            entries: In order of their cursors, at least one.
            begun: The cursor before them.
            selection: Which channels of frames are asked for.
        """
        read = (
            read_hulls(entry, self._layouts.get(entry.layout), selection.channels_of(entry.node))
            for entry in entries
            if entry.frame is not None
        )
        events: list[tuple[str, Mapping[str, object]]] = [
            ("frame", describe_frames(hulls)) for hulls in join_frames(read)
        ]
        rows = [entry.event for entry in entries if entry.event is not None]
        events += [(str(row["kind"]), describe_event(row, self.ids)) for row in rows]
        cursors = [begun] * (len(events) - 1) + [entries[-1].cursor]
        return b"".join(
            self.event(kind, at, data) for (kind, data), at in zip(events, cursors, strict=True)
        )
