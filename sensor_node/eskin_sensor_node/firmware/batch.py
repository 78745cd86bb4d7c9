"""What a node says in one breath."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from typing import Self

    from eskin_sensor_node.firmware.chip import Chip
    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.outbox import Lock, Outbox


class Batch:
    """Messages that become durable together, or are lost together.

    Attributes:
        records: What it says so far, behind a gap if one had to come first.
    """

    def __init__(self, outbox: "Outbox", chip: "Chip", lock: "Lock") -> None:
        self._outbox = outbox
        self._chip = chip
        self._lock = lock
        self._told: list[Record] = []
        self._charge: bytes | None = None
        self.records: list[Record] = []

    def __enter__(self) -> "Self":
        self._lock.__enter__()
        self._told = self._outbox.unsaid()
        self.records = list(self._told)
        return self

    def __exit__(self, kind: "type[BaseException] | None", *_: object) -> None:
        try:
            self._end(kind is None)
        finally:
            self._lock.__exit__(None, None, None)

    def take(self, records: "Iterable[Record]") -> None:
        """Take what the firmware says."""
        self.records.extend(records)

    def keep_charge(self, body: bytes) -> None:
        """Keep something of the supply along; empty: forget what was kept."""
        self._charge = body

    def _end(self, whole: bool) -> None:  # noqa: FBT001
        kept = False
        try:
            if whole:
                self._commit(self.records)
                kept = True
        finally:
            if kept:
                self._outbox.settle(self.records)
            else:
                self._outbox.lose(self.records[len(self._told) :])

    def _commit(self, records: "Sequence[Record]") -> None:
        if not records and self._charge is None:
            return
        committed = False
        self._chip.begin()
        try:
            self._outbox.write(records)
            if self._charge is not None:
                self._chip.keep_charge(self._charge)
            self._chip.commit()
            committed = True
        finally:
            if not committed:
                self._chip.roll_back()
