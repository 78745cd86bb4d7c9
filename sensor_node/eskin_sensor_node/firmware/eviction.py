"""What gives way in a full storage, and the gap that names it."""

from eskin_sensor_node.firmware.gap_reasons import FULL
from eskin_sensor_node.firmware.loss_log import Loss
from eskin_sensor_node.firmware.message_writer import BLOCK, GAP, RESULT

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.chip import Chip, StoredMessage
    from eskin_sensor_node.firmware.message_writer import MessageWriter, Numbers, Record

_GAP_RESERVE = 2048
"""Bytes kept for the gap that tells what gave way."""
_EVENTS = 1
_SHELVES = {BLOCK: 0, RESULT: 2, GAP: 3}
"""Where a message is kept, by its kind; others are events."""
_GIVING_WAY = (_SHELVES[BLOCK], _EVENTS, _SHELVES[GAP], _SHELVES[RESULT])
"""Raw blocks first, peaks and status when there are none. A gap would only have to be said again;
a result tells how the node is set."""


class Level:
    """How full the storage is: messages, bytes, gaps ever recorded."""

    __slots__ = ("gaps", "messages", "used")

    def __init__(self, messages: int, used: int, gaps: int) -> None:
        self.messages = messages
        self.used = used
        self.gaps = gaps


class OpenGap:
    """The last gap of what gave way: it may still grow, as long as nobody has read it."""

    __slots__ = ("loss", "sequence")

    def __init__(self, sequence: int, loss: Loss) -> None:
        self.sequence = sequence
        self.loss = loss


class Change:
    """Messages that enter the storage in one transaction, and what gives way for them.

    Args:
        chip: The storage, with a transaction open.
        message_writer: Writes the gaps.
        numbers: Gives their sequence numbers.
        level: How full it is before; stays as it is.
        opened: The gap that may grow; stays as it is.

    Attributes:
        level: How full it is behind.
        opened: The gap that may grow then.
    """

    def __init__(
        self,
        chip: "Chip",
        message_writer: "MessageWriter",
        numbers: "Numbers",
        level: Level,
        opened: "OpenGap | None",
    ) -> None:
        self._chip = chip
        self._message_writer = message_writer
        self._numbers = numbers
        self.level = Level(level.messages, level.used, level.gaps)
        self.opened = opened

    def insert(self, record: "Record") -> None:
        """Keep a message."""
        self._chip.append(self._chip.boot, record, _SHELVES.get(record.kind, _EVENTS))
        if record.kind == RESULT:
            self._chip.keep_answer(record.body)
        self.level.messages += 1
        self.level.used += len(record.body)
        self.level.gaps += record.kind == GAP

    def make_room(self, capacity: int) -> None:
        """Let the oldest give way until what is left fits, and name it in a gap."""
        if self.level.used <= capacity:
            return
        loss, sequence = self._reopened()
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
        self.opened = OpenGap(sequence, loss)

    def _reopened(self) -> "tuple[Loss, int]":
        if self.opened is None:
            return Loss(FULL), self._numbers.next_sequence()
        self._remove(self._chip.boot, self.opened.sequence)
        self.level.gaps -= 1
        return self.opened.loss.copy(), self.opened.sequence

    def _victim(self) -> "StoredMessage | None":
        for shelf in _GIVING_WAY:
            found = self._chip.oldest(shelf)
            if found is not None:
                return found
        return None

    def _remove(self, boot: int, sequence: int) -> int:
        messages, freed = self._chip.delete(boot, sequence, sequence)
        self.level.messages -= messages
        self.level.used -= freed
        return messages
