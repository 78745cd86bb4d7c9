"""Evicts messages from a full storage, and names them in a gap."""

from eskin_sensor_node.firmware.gap_reasons import FULL
from eskin_sensor_node.firmware.loss_log import Loss
from eskin_sensor_node.firmware.message_writer import BLOCK, GAP, RESULT

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.chip import Chip, StoredMessage
    from eskin_sensor_node.firmware.message_writer import MessageWriter, Numbers, Record

_GAP_RESERVE = 2048
"""Bytes reserved for the gap that names what was evicted."""
_EVENT = 1
_PRIORITIES = {BLOCK: 0, RESULT: 2, GAP: 3}
"""Of a message, by its kind; others are events."""
_EVICTION_ORDER = (_PRIORITIES[BLOCK], _EVENT, _PRIORITIES[GAP], _PRIORITIES[RESULT])
"""Raw blocks first, then peaks and status. An evicted gap would need another gap; a result has the
node's state."""


class Level:
    """How full the storage is: messages, bytes, gaps ever recorded."""

    __slots__ = ("gaps", "messages", "used")

    def __init__(self, messages: int, used: int, gaps: int) -> None:
        self.messages = messages
        self.used = used
        self.gaps = gaps


class OpenGap:
    """The last gap of evicted messages: it may grow until the radio has read it."""

    __slots__ = ("loss", "sequence")

    def __init__(self, sequence: int, loss: Loss) -> None:
        self.sequence = sequence
        self.loss = loss


class Change:
    """Messages that enter the storage in one transaction, and what is evicted for them.

    Args:
        chip: The storage, with a transaction open.
        message_writer: Writes the gaps.
        numbers: Gives their sequence numbers.
        level: How full it is before; stays as it is.
        open_gap: The gap that may grow; stays as it is.

    Attributes:
        level: How full it is behind.
        open_gap: The gap that may grow then.
    """

    def __init__(
        self,
        chip: "Chip",
        message_writer: "MessageWriter",
        numbers: "Numbers",
        level: Level,
        open_gap: "OpenGap | None",
    ) -> None:
        self._chip = chip
        self._message_writer = message_writer
        self._numbers = numbers
        self.level = Level(level.messages, level.used, level.gaps)
        self.open_gap = open_gap

    def insert(self, record: "Record") -> None:
        """Keep a message."""
        self._chip.append(self._chip.boot, record, _PRIORITIES.get(record.kind, _EVENT))
        if record.kind == RESULT:
            self._chip.store_answer(record.body)
        self.level.messages += 1
        self.level.used += len(record.body)
        self.level.gaps += record.kind == GAP

    def make_room(self, capacity: int) -> None:
        """Evict the oldest until what is left fits, and name it in a gap."""
        if self.level.used <= capacity:
            return
        loss, sequence = self._take_open_gap()
        while self.level.used > capacity - _GAP_RESERVE:
            victim = self._victim()
            if victim is None:
                break
            if loss.full:
                self.insert(loss.gap(self._message_writer, sequence))
                loss, sequence = Loss(FULL), self._numbers.next_sequence()
            boot, number = victim.position
            if not self._remove(boot, number):
                break  # a damaged chip, which shows what it does not hold
            loss.take(victim.time, victim.samples, victim.messages)
            loss.name(boot, number, number)
        self.insert(loss.gap(self._message_writer, sequence))
        self.open_gap = OpenGap(sequence, loss)

    def _take_open_gap(self) -> "tuple[Loss, int]":
        if self.open_gap is None:
            return Loss(FULL), self._numbers.next_sequence()
        self._remove(self._chip.boot, self.open_gap.sequence)
        self.level.gaps -= 1
        return self.open_gap.loss.copy(), self.open_gap.sequence

    def _victim(self) -> "StoredMessage | None":
        for priority in _EVICTION_ORDER:
            found = self._chip.oldest(priority)
            if found is not None:
                return found
        return None

    def _remove(self, boot: int, sequence: int) -> int:
        messages, freed = self._chip.delete(boot, sequence, sequence)
        self.level.messages -= messages
        self.level.used -= freed
        return messages
