"""Messages of a stream of frames, each written once for all clients that want the same."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

import cbor2
from cachetools import FIFOCache

from eskin.wire.frames.frame import read_head, replace_sequence, select_patches
from eskin_cloud.schemas.base import dump
from eskin_cloud.schemas.events import describe_event

if TYPE_CHECKING:
    from eskin_cloud.live.layouts import Layouts
    from eskin_cloud.query.opaque_ids import OpaqueIds
    from eskin_cloud.store.feed_entry import FeedEntry, FeedPosition

PATIENCE_NS: Final = 500_000_000
"""So much older than the newest frame of its node a frame may be that a client is sent."""
_KEPT: Final = 512
_FRAME_HEAD: Final = b"\x85" + cbor2.dumps("frame")
"""An array of five, and the first of them."""
_Key: TypeAlias = tuple[int, frozenset[str] | None, bool]


@dataclass(frozen=True, slots=True)
class FrameSelection:
    """What a stream of frames is asked for.

    Attributes:
        nodes: These only; ``None`` for all.
        patches: Ids of patches, to which frames are reduced; ``None`` for all.
    """

    nodes: frozenset[str] | None = None
    patches: frozenset[str] | None = None

    def takes(self, entry: FeedEntry) -> bool:
        """Whether an entry is asked for, as far as its node goes."""
        return self.nodes is None or entry.node in self.nodes


@dataclass(slots=True)
class StretchFilter:
    """Drops what a slow client is not sent: whole stretches, oldest first.

    All pages of a stretch are sent, or none: the first of them decides.
    """

    _decided: dict[str, tuple[tuple[int, int], bool]] = field(default_factory=dict)

    def keeps(self, entry: FeedEntry, stretch: tuple[int, int], newest: int) -> bool:
        """Whether a frame is sent.

        Args:
            entry: The frame; called for each in the order of the feed.
            stretch: Names its stretch within the node.
            newest: When the newest frame of the node was stored, UTC ns.
        """
        before = self._decided.get(entry.node)
        if before is not None and before[0] == stretch:
            return before[1]
        keeps = newest - entry.received <= PATIENCE_NS
        self._decided[entry.node] = stretch, keeps
        return keeps


class FrameMessage(NamedTuple):
    """A frame as a message.

    Attributes:
        stretch: Names its stretch within the node.
        tail: The message without its kind and the position that it states.
    """

    stretch: tuple[int, int]
    tail: bytes


class FrameEncoder:
    """Writes messages, and keeps the latest frames for the next client.

    Args:
        ids: Writes positions.
        layouts: Those of the frames, loaded.
    """

    def __init__(self, ids: OpaqueIds, layouts: Layouts) -> None:
        self.ids = ids
        self._layouts = layouts
        self._kept: FIFOCache[_Key, FrameMessage | None] = FIFOCache(_KEPT)

    def frame(
        self, entry: FeedEntry, selection: FrameSelection, *, sealed: bool
    ) -> FrameMessage | None:
        """A frame, reduced to the patches that are asked for; ``None`` if it has none of them.

        Args:
            entry: The frame.
            selection: What is asked for.
            sealed: Whether the client may know when something sealed comes. Else the sequence of a
                frame beside biometric pages is an opaque number, which counts nothing.
        """
        if entry.secret:
            return self._of_frame(entry, selection.patches, sealed=sealed)
        key = entry.cursor, selection.patches, sealed
        if key not in self._kept:
            self._kept[key] = self._of_frame(entry, selection.patches, sealed=sealed)
        return self._kept[key]

    def _of_frame(
        self, entry: FeedEntry, patches: frozenset[str] | None, *, sealed: bool
    ) -> FrameMessage | None:
        data = entry.frame or b""
        described = self._layouts.get(entry.layout)
        if not sealed and (described is None or described.biometric_pages):
            position = read_head(data).position
            data = replace_sequence(data, self.ids.number(entry.node, *position))
        if patches is not None and described is not None:
            numbers = {k for k, each in enumerate(described.patches) if each.patch_id in patches}
            selected = select_patches(data, numbers)
            if selected is None:
                return None
            data = selected
        tail = b"".join(map(cbor2.dumps, (entry.node, entry.received, data)))
        return FrameMessage(read_head(data).stretch, tail)

    def layout(self, node: str, name: bytes) -> bytes:
        """Which layout the following frames of a node are read by."""
        return cbor2.dumps(["layout", node, name])

    def state(self, message: FrameMessage, place: FeedPosition) -> bytes:
        """A frame with the position that a client's stream has reached."""
        return _FRAME_HEAD + cbor2.dumps(self.ids.write_position(place)) + message.tail

    def event(self, place: FeedPosition, row: dict[str, Any]) -> bytes:
        """A peak, gap, status or command."""
        text = dump(describe_event(row, self.ids)).decode()
        return cbor2.dumps(["event", self.ids.write_position(place), str(row["kind"]), text])

    def contacts(self, place: FeedPosition, node: str, text: str) -> bytes:
        """Contacts at the last instant of a stretch, in JSON."""
        return cbor2.dumps(["contacts", self.ids.write_position(place), node, text])

    def lagging(self, place: FeedPosition, skipped: int | None) -> bytes:
        """How many frames near a position were not sent; with 0 a sign of life.

        ``None`` stands for a number that is not known.
        """
        return cbor2.dumps(["lagging", self.ids.write_position(place), skipped])
