"""A member's outbox: the firmware's, with its sequence numbers in a column."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from eskin_sensor_node.firmware.eviction import Level
from eskin_sensor_node.firmware.outbox import Outbox

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.fleet.report_kernels import Nodes
    from eskin_sensor_node.machine.flash.flash import Partition


class MemberOutbox(Outbox):
    """Its next sequence number stands in a column, where compiled loops count, too.

    Args:
        chip: The member's part of the flash file.
        nodes: Those that started together.
        row: The member's place among them.
        given: As for the firmware's outbox.
    """

    def __init__(self, chip: Partition, nodes: Nodes, row: int, **given: Any) -> None:
        self._nodes = nodes
        self._row = row
        self._partition = chip
        self._records: list[Record] | None = None
        super().__init__(chip, **given)

    @property
    def _sequence(self) -> int:
        return int(self._nodes.sequences[self._row])

    @_sequence.setter
    def _sequence(self, value: int) -> None:
        self._nodes.sequences[self._row] = value

    def settle(self, records: Sequence[Record]) -> None:
        """Take over what was written; durable now, or with the file's transaction."""
        super().settle(records)
        if self._records is not None:
            self._records += records

    def begin_savepoint(self) -> None:
        """Remember the state, for `undo`."""
        self._records = []
        self._marked = self._level, self._open_gap, self._settled, self._pending_loss, self.boot

    def end_savepoint(self) -> None:
        """Stop remembering: the member's messages are written with those of its cohort."""
        self._records = None

    def undo(self) -> None:
        """Undo that transaction: its messages are lost, and the next batch reports it."""
        self._level, self._open_gap, self._settled, self._pending_loss, boot = self._marked
        if boot != self.boot:
            self._settled = 0
            self._partition.recount()
        self.newest_status = self._introduction = None
        self.lose(self._records or [])

    def resync(self, now: int) -> None:
        """Count and send anew what the file holds, after an acknowledgement was undone."""
        messages, used = self._partition.level()
        self._level = Level(messages, used, self._level.gaps)
        self.connect(now)
