"""What the live feed is told of each message that was stored."""

from __future__ import annotations

from typing import Any, NamedTuple


class FeedEntry(NamedTuple):
    """One block or event, at its place in the feed; a tuple, because there are many.

    Attributes:
        cursor: Place in the feed; later messages have a greater one.
        node: Who said it.
        channel: Of which channel; ``None`` for a gap or a status.
        block: The block's bytes; ``None`` for an event.
        event: The event's row; ``None`` for a block.
        received: When the cloud stored it, UTC ns.
        veiled: A sealed block or peak; then there is neither of them.
    """

    cursor: int
    node: str
    channel: str | None
    block: bytes | None
    event: dict[str, Any] | None
    received: int
    veiled: bytes | None = None

    @property
    def size(self) -> int:
        """Bytes of the message."""
        body = self.block or self.veiled
        if body is None and self.event is not None:
            body = self.event.get("data")
        return len(body or b"")
