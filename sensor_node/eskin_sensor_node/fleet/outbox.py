"""A member's outbox: the firmware's, which counts together with others'."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from eskin_sensor_node.firmware.eviction import Level
from eskin_sensor_node.firmware.outbox import Outbox

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.fleet.message_kernels import Nodes
    from eskin_sensor_node.fleet.storage import Partition


class MemberOutbox(Outbox):
    """Its next sequence number stands in a column, where compiled loops count, too.

    Args:
        chip: The member's part of the storage.
        nodes: Those that started together.
        row: The member's place among them.
        given: As the firmware's outbox takes it.
    """

    def __init__(self, chip: Partition, nodes: Nodes, row: int, **given: Any) -> None:
        self._nodes = nodes
        self._row = row
        self._partition = chip
        self._said: list[Record] | None = None
        super().__init__(chip, **given)

    @property
    def _sequence(self) -> int:
        return int(self._nodes.sequences[self._row])

    @_sequence.setter
    def _sequence(self, value: int) -> None:
        self._nodes.sequences[self._row] = value

    def settle(self, records: Sequence[Record]) -> None:
        """What was written is durable, or will be with the storage's transaction for many."""
        super().settle(records)
        if self._said is not None:
            self._said += records

    def mark(self) -> None:
        """A transaction for many begins: from here on `undo` undoes."""
        self._said = []
        self._marked = self._level, self._opened, self._settled, self._unsaid, self.boot

    def unmark(self) -> None:
        """From now on the member's messages are written with those of its cohort."""
        self._said = None

    def undo(self) -> None:
        """That transaction failed: what was said since is lost, and the next batch tells so."""
        self._level, self._opened, self._settled, self._unsaid, boot = self._marked
        if boot != self.boot:
            self._settled = 0
            self._partition.recount()
        self.newest_status = self._introduction = None
        self.lose(self._said or [])

    def look_again(self, now: int) -> None:
        """The storage undid what was acknowledged: count and send anew what it holds."""
        messages, used = self._partition.level()
        self._level = Level(messages, used, self._level.gaps)
        self.connect(now)
