"""What a stream of frames is asked for, and which frames a slow client is not sent."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from eskin_cloud.store.feed_entry import FeedEntry

PATIENCE_NS: Final = 500_000_000
"""So much older than the newest frame of its node a frame may be that a client is sent."""


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
