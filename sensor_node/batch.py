"""What a node says in one breath."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eskin.messages import Message, Position
    from sensor_node.flash import Flash


class Batch:
    """Messages that become durable together."""

    def __init__(self, flash: Flash) -> None:
        self._flash = flash
        self.messages: list[Message] = []

    def position(self) -> Position:
        """The next message's position; never given out again."""
        return self._flash.next_position()

    def add(self, message: Message) -> None:
        """Add a message."""
        self.messages.append(message)
