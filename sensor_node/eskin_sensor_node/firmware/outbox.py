"""The outbox: messages wait here until a gateway acknowledges them.

The chip stores the messages and the radio sends them; the outbox decides what to send next, when
to send it again, what to delete and what to evict.
"""

from eskin_sensor_node.firmware.eviction import Change, Level, Loss
from eskin_sensor_node.firmware.gap_reasons import FAILED
from eskin_sensor_node.firmware.message_writer import STATUS, MessageWriter

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from types import TracebackType
    from typing import Protocol, Self

    from eskin_sensor_node.firmware.chip import Chip, Position, StoredMessage
    from eskin_sensor_node.firmware.eviction import OpenGap
    from eskin_sensor_node.firmware.message_writer import Numbers, Record

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
"""An instant that is over."""


class InFlightWindow:
    """Messages handed to the radio and not yet acknowledged, and since when.

    Args:
        size: Messages that may be under way at once.
        patience: Time from leaving the radio until a message counts as late; the unit is the
            caller's.
    """

    __slots__ = ("_left", "_patience", "_quiet_until", "_size")

    def __init__(self, size: int, patience: int) -> None:
        self._size = size
        self._patience = patience
        # None: the radio still has it, and would only get it twice.
        self._left: dict[Position, int | None] = {}
        # Nothing is late before.
        self._quiet_until: int | None = None

    @property
    def room(self) -> int:
        """How many more may go."""
        return self._size - len(self._left)

    def __contains__(self, position: "Position") -> bool:
        return position in self._left

    def hand_over(self, position: "Position") -> None:
        """The radio has it now."""
        self._left[position] = None

    def note_sent(self, position: "Position", now: int) -> None:
        """The radio is rid of it, sent or not."""
        if position in self._left:
            self._left[position] = now
            if self._quiet_until is None:
                self._quiet_until = now + self._patience

    def late(self, now: int) -> "list[Position]":
        """What went out too long ago, oldest message first."""
        if self._quiet_until is None or now <= self._quiet_until:
            return []
        late = []
        first = None
        for position, left in self._left.items():
            if left is None:
                continue
            if now - left > self._patience:
                late.append(position)
            elif first is None or left < first:
                first = left
        if not late:
            self._quiet_until = None if first is None else first + self._patience
        return sorted(late)

    def forget(self, position: "Position") -> None:
        """It is gone."""
        self._left.pop(position, None)

    def named(self, spans: "Sequence[tuple[int, int, int]]") -> "list[Position]":
        """What is under way of all that ``(boot, first, last)`` name."""
        found = []
        for boot, first, last in spans:
            found += [p for p in self._left if p[0] == boot and first <= p[1] <= last]
        return found

    def acknowledge(self, spans: "Sequence[tuple[int, int, int]]") -> None:
        """Forget what ``(boot, first, last)`` name."""
        for position in self.named(spans):
            self.forget(position)

    def clear(self) -> None:
        """Nothing is under way: the radio has lost its connection."""
        self._left = {}
        self._quiet_until = None


class NoLock:
    """For a control unit that does one thing at a time."""

    def __enter__(self) -> None:
        """Do nothing."""

    def __exit__(self, *_: object) -> None:
        """Do nothing."""


class Outbox:
    """A node's outbox.

    A message leaves it acknowledged, or named by a gap because it was evicted or could not be
    written. Over capacity the oldest samples are evicted first, then the oldest statements and
    status, and gaps and results last. Descriptions of frames have no position and are kept in a
    reserved part of the chip.

    Instants are the caller's, in one unit; positions are ``(boot, sequence)``.

    Args:
        chip: The storage.
        capacity: Bytes of messages that it may hold.
        window: Messages under way without acknowledgement.
        resend_after: Time from leaving the radio until a message is sent again.
        status_every: Time between two status messages.
        message_writer: Makes what writes messages, of a boot and of what counts them.
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
        message_writer: "Callable[[int, Numbers], MessageWriter]",
        lock: "Lock | None" = None,
    ) -> None:
        self._chip = chip
        self._make_writer = message_writer
        self.capacity = capacity
        self._lock = lock or NoLock()
        self._window = InFlightWindow(window, resend_after)
        self._status_every = status_every
        # Survives a reset, as a retained register does: every loss is reported.
        self._pending_loss = Loss(FAILED)
        self._start()

    def _start(self) -> None:
        self.boot = self._chip.boot
        self.message_writer = self._make_writer(self.boot, self)
        messages, used = self._chip.level()
        self._level = Level(messages, used, self._chip.gaps())
        self._sequence = self._settled = 0
        self._open_gap: OpenGap | None = None
        self._change: Change | None = None
        self._window.clear()
        self._sent_up_to = _BEFORE_ALL
        self.newest_status: Position | None = None
        self._introduction: Position | None = None
        self._status_at: int | None = None

    def restart(self) -> None:
        """Start anew after a reset of the machine: another boot, and all that waits is sent again.

        The radio stays connected, and sends a status first. If the chip cannot count the
        boot, the old one goes on.
        """
        with self._lock:
            self._chip.restart()
            connected = self._status_at is not None
            self._start()
            if connected:
                self._status_at = _AT_ONCE

    # Messages of the node.

    def next_sequence(self) -> int:
        """Give out the next number; only for use inside of a batch."""
        self._sequence += 1
        return self._sequence - 1

    def batch(self) -> "Batch":
        """Messages that become durable together: in one commit, at the end of a ``with``.

        What fails is lost, and the next batch that can be written reports it in a gap.
        """
        return Batch(self, self._chip, self._lock)

    def pending_gap(self) -> "list[Record]":
        """The gap that must come first, if something could not be written before."""
        if self._pending_loss.time is None:
            return []
        return [self._pending_loss.gap(self.message_writer, self.next_sequence())]

    def write(self, records: "Sequence[Record]") -> None:
        """Put messages into the chip's open transaction; `settle` or `lose` must follow."""
        change = Change(self._chip, self.message_writer, self, self._level, self._open_gap)
        for record in records:
            change.insert(record)
        change.make_room(self.capacity)
        self._chip.store_counts(change.level.gaps, self._sequence - 1)
        self._change = change

    def settle(self, records: "Sequence[Record]") -> None:
        """Take over what was written: it is durable now."""
        if self._change is not None:
            self._level, self._open_gap = self._change.level, self._change.open_gap
            self._change = None
        self._pending_loss = Loss(FAILED)
        self._settled = self._sequence
        for record in records:
            if record.kind == STATUS:
                self.newest_status = self._introduction = self.boot, record.sequence

    def lose(self, records: "Sequence[Record]") -> None:
        """Count what was not written as lost; the next batch reports it."""
        self._change = None
        for record in records:
            time = record.earliest, record.latest
            self._pending_loss.take(time, record.samples, 1 + record.named)
        if self._sequence > self._settled:
            self._pending_loss.name(self.boot, self._settled, self._sequence - 1)

    def usage(self) -> "tuple[int, int, int, int]":
        """Waiting messages, their bytes, capacity in bytes, gaps ever recorded."""
        level = self._level
        return level.messages, level.used, self.capacity, level.gaps

    @property
    def messages(self) -> int:
        """How many wait."""
        return self._level.messages

    def describe(self, layout: bytes, descriptions: "dict[bytes, bytes]") -> None:
        """Keep what this node's frames are read by.

        Args:
            layout: Hash of the layout.
            descriptions: It and its patches, by their hashes.
        """
        with self._lock:
            self._chip.store_descriptions(layout, descriptions)

    # Requests of the radio.

    def descriptions(self) -> "list[bytes]":
        """Hashes of what the node says after each connection, before any frame."""
        with self._lock:
            return self._chip.descriptions()

    def description(self, name: bytes) -> "bytes | None":
        """The layout or patch of a hash; None if the node has none."""
        with self._lock:
            return self._chip.description(name)

    def connect(self, now: int) -> None:
        """After a new connection, send everything again, a status first."""
        with self._lock:
            self._window.clear()
            self._sent_up_to = _BEFORE_ALL
            self.newest_status = self._introduction = None
            self._status_at = now

    def introduce(self, now: int) -> None:
        """After a new certificate, send a status at once, which carries it."""
        with self._lock:
            self.newest_status = None
            if self._status_at is not None:
                self._status_at = now

    def is_status_due(self, now: int) -> bool:
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
                # Not a slice: evicted messages take no place.
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

    def mark_sent(self, position: "Position", now: int) -> None:
        """The radio has sent or dropped a message; its acknowledgement is awaited."""
        with self._lock:
            self._window.note_sent(position, now)

    def acknowledge(self, spans: "Sequence[tuple[int, int, int]]") -> None:
        """Delete what a gateway has made durable: ``(boot, first, last)``.

        If the chip cannot delete them, they stay, and are sent again.
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
        """The charge that the last boot stored; empty where it stored none."""
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
        if self._open_gap is not None and kept.position == (self.boot, self._open_gap.sequence):
            self._open_gap = None


class Batch:
    """Messages that become durable together, or are lost together.

    Attributes:
        records: Its messages so far, behind a gap if one was pending.
    """

    def __init__(self, outbox: "Outbox", chip: "Chip", lock: "Lock") -> None:
        self._outbox = outbox
        self._chip = chip
        self._lock = lock
        self._pending: list[Record] = []
        self._charge: bytes | None = None
        self.records: list[Record] = []

    def __enter__(self) -> "Self":
        self._lock.__enter__()
        self._pending = self._outbox.pending_gap()
        self.records = list(self._pending)
        return self

    def __exit__(self, kind: "type[BaseException] | None", *_: object) -> None:
        try:
            self._end(kind is None)
        finally:
            self._lock.__exit__(None, None, None)

    def take(self, records: "Iterable[Record]") -> None:
        """Add messages."""
        self.records.extend(records)

    def store_charge(self, body: bytes) -> None:
        """Store the charge along; empty: delete it."""
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
                self._outbox.lose(self.records[len(self._pending) :])

    def _commit(self, records: "Sequence[Record]") -> None:
        if not records and self._charge is None:
            return
        committed = False
        self._chip.begin()
        try:
            self._outbox.write(records)
            if self._charge is not None:
                self._chip.store_charge(self._charge)
            self._chip.commit()
            committed = True
        finally:
            if not committed:
                self._chip.roll_back()
