"""Entries of the feed as events of a stream; each is written once for all streams that want it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeAlias

from cachetools import FIFOCache

from eskin_cloud.live.frame_hulls import describe_frames, join_frames, read_hulls
from eskin_cloud.schemas.base import dump
from eskin_cloud.schemas.events import describe_event

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin_cloud.live.layouts import Layouts
    from eskin_cloud.query.opaque_ids import OpaqueIds
    from eskin_cloud.store.feed_entry import FeedEntry, FeedPosition

_KEPT: Final = 512
_PAGES: Final = 16
_Page: TypeAlias = "tuple[FeedPosition, tuple[int, ...], Subscription]"
"""Where it begins, its entries, and what is asked for. The last entry does not name the others:
memory holds slots in the order in which they came, and the store is read slot by slot."""


@dataclass(frozen=True, slots=True)
class Subscription:
    """What a stream is asked for.

    Attributes:
        nodes: These only; all if empty.
        channels: These ``(node, channel)`` only, as far as frames and peaks go; all if empty.
        points: Hulls that the rows of a patch become at most, of each frame.
    """

    nodes: frozenset[str]
    channels: frozenset[tuple[str, str]]
    points: int = 1

    @property
    def looked_at(self) -> frozenset[str]:
        """The nodes that it is of; all if empty."""
        return self.nodes | {node for node, _ in self.channels}

    def takes(self, entry: FeedEntry) -> bool:
        """Whether an entry is asked for; what a node says of itself comes with its channels."""
        if self.nodes and entry.node not in self.nodes:
            return False
        if not self.channels:
            return True
        if entry.channel is None:
            return any(node == entry.node for node, _ in self.channels)
        return (entry.node, entry.channel) in self.channels

    def channels_of(self, node: str) -> frozenset[str] | None:
        """Which channels of a node's frames are asked for; ``None`` for all."""
        if not self.channels:
            return None
        return frozenset(channel for name, channel in self.channels if name == node)


class SseEncoder:
    """Prints entries, and keeps the latest ones for the next who asks for the same.

    What was sealed is not kept.

    Args:
        ids: Writes positions.
        layouts: Those of the frames, loaded.
    """

    def __init__(self, ids: OpaqueIds, layouts: Layouts) -> None:
        self.ids = ids
        self._layouts = layouts
        self._frames: FIFOCache[tuple[int, frozenset[str] | None, int], bytes] = FIFOCache(_KEPT)
        self._pages: FIFOCache[_Page, bytes] = FIFOCache(_PAGES)

    def page(
        self, found: Sequence[FeedEntry], selection: Subscription, begun: FeedPosition
    ) -> bytes:
        """What is asked for of neighbours in the feed, of which nothing is sealed.

        Many readers select the same: their entries are encoded once.
        """
        if not found:
            return b""
        key = begun, tuple(entry.cursor for entry in found), selection
        page = self._pages.get(key)
        if page is None:
            chosen: list[tuple[FeedEntry, FeedPosition, bool]] = []
            for entry in found:
                begun = begun.advance([entry.cursor])
                if selection.takes(entry):
                    chosen.append((entry, begun, True))
            page = self._pages[key] = self.print(chosen, selection)
        return page

    def print(
        self, chosen: Sequence[tuple[FeedEntry, FeedPosition, bool]], selection: Subscription
    ) -> bytes:
        """Entries as events of the stream.

        Args:
            chosen: Each with the position that its event states, and with whether others may be
                given the same data.
            selection: Which channels of frames are asked for, and how finely.
        """
        return b"".join(
            self._event(entry, place, selection, keep=keep) for entry, place, keep in chosen
        )

    def _event(
        self, entry: FeedEntry, place: FeedPosition, selection: Subscription, *, keep: bool
    ) -> bytes:
        if entry.frame is None:
            row = entry.event or {}
            return self.event(str(row["kind"]), place, describe_event(row, self.ids))
        key = entry.cursor, selection.channels_of(entry.node), selection.points
        data = self._frames.get(key) if keep else None
        if data is None:
            data = self._of_frame(entry, *key[1:])
            if keep:
                self._frames[key] = data
        return self._event_of("frame", place, data) if data else b""

    def _of_frame(self, entry: FeedEntry, channels: frozenset[str] | None, points: int) -> bytes:
        """A frame's data; nothing where it has none of the channels, or its layout is lost."""
        hulls = read_hulls(entry, self._layouts.get(entry.layout), channels, points)
        return b"" if hulls is None else dump(describe_frames(hulls))

    def event(self, kind: str, place: FeedPosition, data: object) -> bytes:
        """One event of a stream."""
        return self._event_of(kind, place, dump(data))

    def _event_of(self, kind: str, place: FeedPosition, data: bytes) -> bytes:
        parts = kind.encode(), self.ids.write_position(place).encode(), data
        return b"event: %b\nid: %b\ndata: %b\n\n" % parts

    def join(
        self,
        entries: Sequence[FeedEntry],
        selection: Subscription,
        *,
        begun: FeedPosition,
        end: FeedPosition,
    ) -> bytes:
        """Many entries at once, for one who reads too slowly: fewer events, and wider hulls.

        Frames of a page that follow each other without a gap become one hull; all else is sent as
        it is. Only the last event states the last entry's position, so a
        reader that breaks off before it is sent all of them again.

        Args:
            entries: In their order, at least one.
            selection: Which channels of frames are asked for.
            begun: The position before them.
            end: The position after them.
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
        places = [begun] * (len(events) - 1) + [end]
        return b"".join(
            self.event(kind, at, data) for (kind, data), at in zip(events, places, strict=True)
        )
