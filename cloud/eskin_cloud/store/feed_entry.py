"""Entries of the live feed."""

from __future__ import annotations

from typing import Any, NamedTuple


class FeedEntry(NamedTuple):
    """A stored frame or event, with its cursor; a tuple, because there are many.

    Attributes:
        cursor: Position in the feed; it grows with each message.
        node: The node.
        channel: The channel of a peak; ``None`` for anything else.
        event: The event's row; ``None`` for a frame.
        received: When the cloud stored it, UTC ns.
        sealed: A sealed message; ``event`` and ``frame`` are then ``None``.
        frame: The frame's bytes; ``None`` for anything else.
        layout: Hash of the layout by which the frame, or what is sealed, is read.
        secret: Whether the frame was opened for one client: no cache may keep it.
    """

    cursor: int
    node: str
    channel: str | None
    event: dict[str, Any] | None
    received: int
    sealed: bytes | None = None
    frame: bytes | None = None
    layout: bytes | None = None
    secret: bool = False

    @property
    def size(self) -> int:
        """Bytes of the message."""
        body = self.frame or self.sealed
        if body is None and self.event is not None:
            body = self.event.get("data")
        return len(body or b"")
