"""Evicts messages from a full storage, and collects losses until a gap names them."""

from eskin_sensor_node.firmware.gap_reasons import FULL
from eskin_sensor_node.firmware.message_writer import FRAME, RESULT

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.chip import Chip, StoredMessage
    from eskin_sensor_node.firmware.message_writer import MessageWriter, Numbers, Record


_GAP_RESERVE = 2048
"""Bytes reserved for the gap that names what was evicted."""
_SAMPLES, _EVENT, _RESULT, _GAP = 0, 1, 2, 3
"""Priorities of messages, as the flash keeps them."""
_EVICTION_ORDER = (_SAMPLES, _EVENT, _GAP, _RESULT)
"""Samples first, then statements and status. An evicted gap would need another gap; a result has
the node's state."""
MOST_SPANS = 64
"""Ranges of positions that one gap can name."""


def _priority(record: "Record") -> int:
    if record.kind == FRAME:
        return _SAMPLES
    if record.kind == RESULT:
        return _RESULT
    return _GAP if record.gaps else _EVENT


class Loss:
    """Messages lost for one reason.

    Attributes:
        reason: A code of `eskin_sensor_node.firmware.gap_reasons`.
        time: UTC ns, earliest and latest instant that is affected; None: nothing is lost.
        messages: How many messages.
        samples: How many samples, over all channels.
        spans: ``(boot, first, last)`` of the positions, sorted, as few as possible.
    """

    __slots__ = ("messages", "reason", "samples", "spans", "time")

    def __init__(self, reason: int) -> None:
        self.reason = reason
        self.time: tuple[int, int] | None = None
        self.messages = 0
        self.samples = 0
        self.spans: list[tuple[int, int, int]] = []

    def copy(self) -> "Loss":
        """A copy."""
        made = Loss(self.reason)
        made.time = self.time
        made.messages = self.messages
        made.samples = self.samples
        made.spans = list(self.spans)
        return made

    def take(self, time: "tuple[int, int]", samples: int, messages: int) -> None:
        """Count in a message: the time it covers, its samples, how many it stands for."""
        known = self.time or time
        self.time = min(known[0], time[0]), max(known[1], time[1])
        self.samples += samples
        self.messages += messages

    def name(self, boot: int, first: int, last: int) -> None:
        """Name lost positions; adjacent ranges are merged."""
        spans = self.spans
        at = len(spans)
        while at > 0 and spans[at - 1] > (boot, first, last):
            at -= 1
        spans.insert(at, (boot, first, last))
        k = max(at - 1, 0)
        while k + 1 < len(spans) and k <= at:
            one, other = spans[k], spans[k + 1]
            if one[0] == other[0] and other[1] <= one[2] + 1:
                spans[k] = one[0], one[1], max(one[2], other[2])
                del spans[k + 1]
            else:
                k += 1

    @property
    def full(self) -> bool:
        """Whether one gap might not name one position more."""
        return len(self.spans) >= MOST_SPANS

    def gap(self, message_writer: "MessageWriter", sequence: int) -> "Record":
        """The gap, at a position that was given out before."""
        time = self.time or (0, 0)
        return message_writer.gap(
            self.reason, time, self.samples, self.messages, self.spans, sequence
        )


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
        self._chip.append(self._chip.boot, record, _priority(record))
        if record.kind == RESULT:
            self._chip.store_answer(record.body)
        self.level.messages += 1
        self.level.used += len(record.body)
        self.level.gaps += record.gaps

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
