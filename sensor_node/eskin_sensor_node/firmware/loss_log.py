"""Lost messages and samples, collected until a gap reports them."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.message_writer import MessageWriter, Record

MOST_SPANS = 64
"""Ranges of positions that one gap can name."""


class Loss:
    """Messages lost for one reason.

    Attributes:
        reason: A code of `eskin_sensor_node.firmware.gap_reasons`.
        time: UTC ns, earliest and latest moment that is affected; None: nothing is lost.
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
