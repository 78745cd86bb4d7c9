"""Everything that a node says waits here until a gateway acknowledges it.

The chip keeps the messages and the radio carries them; what waits, what goes out next, when it goes
out again, what is forgotten and what gives way is decided here.
"""

from eskin_sensor_node.firmware.batch import Batch
from eskin_sensor_node.firmware.eviction import Change, Level
from eskin_sensor_node.firmware.gap_reasons import FAILED
from eskin_sensor_node.firmware.loss_log import Loss
from eskin_sensor_node.firmware.message_writer import STATUS, MessageWriter
from eskin_sensor_node.firmware.window import Window

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType
    from typing import Protocol

    from eskin_sensor_node.firmware.chip import Chip, Position, StoredMessage
    from eskin_sensor_node.firmware.eviction import OpenGap
    from eskin_sensor_node.firmware.message_writer import Record

    class Lock(Protocol):
        """Keeps others out while it is held; its holder may take it again."""

        def __enter__(self) -> object:
            """Take it."""

        def __exit__(
            self,
            __kind: type[BaseException] | None,  # noqa: PYI063 - MicroPython knows no /
            __error: BaseException | None,
            __trace: TracebackType | None,
        ) -> object:
            """Give it back."""


_BEFORE_ALL = (-1, -1)
_AT_ONCE = 0
"""A moment that is over."""


class NoLock:
    """For a control unit that does one thing at a time."""

    def __enter__(self) -> None:
        """Nobody else is there."""

    def __exit__(self, *_: object) -> None:
        """Nobody waits."""


class Outbox:
    """A node's outbox.

    A message leaves it in one of two ways: acknowledged, or named by a gap because it had to give
    way or could not be written. Over capacity the oldest raw blocks give way first, then the oldest
    peaks and status, and gaps and results last.

    Moments are the caller's, in one unit; positions are ``(boot, sequence)``.

    Args:
        chip: The storage.
        capacity: Bytes of messages that it may hold.
        window: Messages under way without acknowledgement.
        resend_after: Time from leaving the radio until a message is sent again.
        status_every: Time between two status messages.
        message_writer: What writes messages.
        lock: Where several threads use it; they must be able to take it twice.

    Attributes:
        boot: Number of this start.
        message_writer: Writes messages with this outbox's numbers.
        capacity: As given.
        newest_status: Position of the latest status since the radio connected.
    """

    def __init__(
        self,
        chip: "Chip",
        *,
        capacity: int,
        window: int,
        resend_after: int,
        status_every: int,
        message_writer: "type[MessageWriter]" = MessageWriter,
        lock: "Lock | None" = None,
    ) -> None:
        self._chip = chip
        self._hand = message_writer
        self.capacity = capacity
        self._lock = lock or NoLock()
        self._window = Window(window, resend_after)
        self._status_every = status_every
        # Survives a reset, as a retained register does: no loss goes untold.
        self._unsaid = Loss(FAILED)
        self._start()

    def _start(self) -> None:
        self.boot = self._chip.boot
        self.message_writer = self._hand(self.boot, self)
        messages, used = self._chip.level()
        self._level = Level(messages, used, self._chip.gaps())
        self._sequence = self._settled = 0
        self._opened: OpenGap | None = None
        self._change: Change | None = None
        self._window.clear()
        self._sent_up_to = _BEFORE_ALL
        self.newest_status: Position | None = None
        self._introduction: Position | None = None
        self._status_at: int | None = None

    def restart(self) -> None:
        """Start anew after a reset of the machine: another boot, and all that waits is sent again.

        The radio stays connected, and hears a status first of all. If the chip cannot count the
        boot, the old one goes on.
        """
        with self._lock:
            self._chip.restart()
            connected = self._status_at is not None
            self._start()
            if connected:
                self._status_at = _AT_ONCE

    # What the node says.

    def next_sequence(self) -> int:
        """Give out the next number; only for use inside of a batch."""
        self._sequence += 1
        return self._sequence - 1

    def batch(self) -> Batch:
        """Messages that become durable together: in one commit, at the end of a ``with``.

        What fails is lost, and the next batch that can be written tells so in a gap.
        """
        return Batch(self, self._chip, self._lock)

    def unsaid(self) -> "list[Record]":
        """The gap that must come first, if something could not be written before."""
        if self._unsaid.time is None:
            return []
        return [self._unsaid.gap(self.message_writer, self.next_sequence())]

    def write(self, records: "Sequence[Record]") -> None:
        """Put messages into the chip's open transaction; `settle` or `lose` must follow."""
        change = Change(self._chip, self.message_writer, self, self._level, self._opened)
        for record in records:
            change.insert(record)
        change.make_room(self.capacity)
        self._chip.keep_counts(change.level.gaps, self._sequence - 1)
        self._change = change

    def settle(self, records: "Sequence[Record]") -> None:
        """What was written is durable now."""
        if self._change is not None:
            self._level, self._opened = self._change.level, self._change.opened
            self._change = None
        self._unsaid = Loss(FAILED)
        self._settled = self._sequence
        for record in records:
            if record.kind == STATUS:
                self.newest_status = self._introduction = self.boot, record.sequence

    def lose(self, records: "Sequence[Record]") -> None:
        """What was to be written is lost; the next batch tells so."""
        self._change = None
        for record in records:
            time = record.earliest, record.latest
            self._unsaid.take(time, record.samples, 1 + record.named)
        if self._sequence > self._settled:
            self._unsaid.name(self.boot, self._settled, self._sequence - 1)

    def usage(self) -> "tuple[int, int, int, int]":
        """Waiting messages, their bytes, capacity in bytes, gaps ever recorded."""
        level = self._level
        return level.messages, level.used, self.capacity, level.gaps

    @property
    def messages(self) -> int:
        """How many wait."""
        return self._level.messages

    # What the radio asks, and tells.

    def connect(self, now: int) -> None:
        """The radio has a new connection: everything is to be sent, a status first of all."""
        with self._lock:
            self._window.clear()
            self._sent_up_to = _BEFORE_ALL
            self.newest_status = self._introduction = None
            self._status_at = now

    def introduce(self, now: int) -> None:
        """The radio has a new certificate: a status is due at once, which carries it."""
        with self._lock:
            self.newest_status = None
            if self._status_at is not None:
                self._status_at = now

    def tell_status(self, now: int) -> bool:
        """Whether to record a status now; asked once, the next is due a period later.

        One unanswered status is enough: it is sent again, and more would only pile up.
        """
        if self._status_at is None or now < self._status_at:
            return False
        if self.newest_status is not None and self.newest_status in self._window:
            return False
        self._status_at = now + self._status_every
        return True

    def due(self, now: int, most: int) -> "list[StoredMessage]":
        """What the radio is to send now; it has them from here on.

        A new status goes first, then what was not acknowledged in time, then what was not sent yet,
        oldest first.
        """
        with self._lock:
            found: list[StoredMessage] = []
            if self._introduction is not None:
                self._take(self._introduction, found)
                self._introduction = None
            for position in self._window.late(now):
                # Not a slice: what gave way meanwhile takes nobody's place.
                if len(found) < most:
                    self._take(position, found)
            while (limit := min(most - len(found), self._window.room)) > 0:
                fresh = self._chip.after(self._sent_up_to, limit)
                for kept in fresh:
                    self._sent_up_to = kept.position
                    if kept.position not in self._window:
                        self._hand_over(kept, found)
                if len(fresh) < limit:
                    break
            return found

    def left(self, position: "Position", now: int) -> None:
        """The radio is rid of a message, sent or not; from here on it is missed."""
        with self._lock:
            self._window.note_left(position, now)

    def awaits(self, spans: "Sequence[tuple[int, int, int]]") -> bool:
        """Whether something is under way of what ``(boot, first, last)`` name."""
        with self._lock:
            return bool(self._window.named(spans))

    def acknowledge(self, spans: "Sequence[tuple[int, int, int]]") -> None:
        """Forget what a gateway has made durable: ``(boot, first, last)``.

        If the chip cannot forget, they stay, and are sent again.
        """
        with self._lock:
            messages = freed = 0
            forgotten = False
            self._chip.begin()
            try:
                for boot, first, last in spans:
                    gone, size = self._chip.delete(boot, first, last)
                    messages, freed = messages + gone, freed + size
                self._chip.commit()
                forgotten = True
            finally:
                if not forgotten:
                    self._chip.roll_back()
            level = self._level
            self._level = Level(level.messages - messages, level.used - freed, level.gaps)
            self._window.acknowledge(spans)

    @property
    def settled(self) -> "Position":
        """A position of this boot below which all was kept, or is named by a gap."""
        return self.boot, self._settled

    def held(self) -> "Position":
        """A position below which nothing waits or will come."""
        with self._lock:
            first = self._chip.after(_BEFORE_ALL, 1)
            return min(self.settled, first[0].position) if first else self.settled

    def ended(self) -> "list[Position]":
        """The latest former boots in which a message was kept, and the last number of each."""
        with self._lock:
            return self._chip.ended()

    def answer(self) -> "bytes | None":
        """The last result, also after it was acknowledged."""
        with self._lock:
            return self._chip.answer()

    def charge(self) -> bytes:
        """What the last life kept of its supply; empty where it kept nothing."""
        with self._lock:
            return self._chip.charge()

    def _take(self, position: "Position", found: "list[StoredMessage]") -> None:
        kept = self._chip.read(position)
        if kept is None:
            self._window.forget(position)
        else:
            self._hand_over(kept, found)

    def _hand_over(self, kept: "StoredMessage", found: "list[StoredMessage]") -> None:
        self._window.hand_over(kept.position)
        found.append(kept)
        if self._opened is not None and kept.position == (self.boot, self._opened.sequence):
            self._opened = None
