"""What a node says in one breath."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sensor_node.stored import record_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eskin.messages import Message, Position
    from sensor_node.firmware.record import Record
    from sensor_node.flash import Flash


class Batch:
    """Messages that become durable together."""

    def __init__(self, flash: Flash) -> None:
        self._flash = flash
        self.records: list[Record] = []

    def position(self) -> Position:
        """The next message's position; never given out again."""
        return self._flash.next_position()

    def take(self, records: Iterable[Record]) -> None:
        """Take what the firmware says."""
        self.records.extend(records)

    def add(self, message: Message) -> None:
        """Add a message that the machine itself says."""
        self.records.append(record_of(message))
