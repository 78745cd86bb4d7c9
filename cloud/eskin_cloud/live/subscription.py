"""What a live stream is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eskin_cloud.store.feed_entry import FeedEntry


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
