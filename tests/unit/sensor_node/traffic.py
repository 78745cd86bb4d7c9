"""What a radio sends and receives, where nobody pays for it."""

from __future__ import annotations


class Traffic:
    """A meter that only counts bytes."""

    def __init__(self) -> None:
        self.sent = self.received = 0
