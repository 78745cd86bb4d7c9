"""Works off a script of what happens to an outbox; runs under CPython and MicroPython alike."""

from eskin_sensor_node.firmware.message_writer import RESULT, MessageWriter, Record
from eskin_sensor_node.firmware.outbox import Outbox
from eskin_sensor_node.firmware.peaks import CERTAIN

from tests.contract.micropython.chip import MemoryChip

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from eskin_sensor_node.firmware.message_writer import Numbers


class Delivery:
    """An outbox on a chip in memory, and a clock.

    Args:
        capacity: The outbox's, in bytes.
        window: Messages under way at once.
        resend_after: When it sends again.
        status_every: Time between two status messages.
        layout: Hash of the node's layout, in hexadecimal.
    """

    def __init__(
        self,
        capacity: int,
        window: int,
        resend_after: int,
        status_every: int,
        layout: str,
    ) -> None:
        self._layout = bytes.fromhex(layout)
        self._limits = capacity, window, resend_after, status_every
        self.chip = MemoryChip()
        self.now = 0
        self.outbox = self._made()

    def _made(self) -> Outbox:
        capacity, window, resend_after, status_every = self._limits
        return Outbox(
            self.chip,
            capacity=capacity,
            window=window,
            resend_after=resend_after,
            status_every=status_every,
            message_writer=self._writer,
        )

    def _writer(self, boot: int, numbers: "Numbers") -> MessageWriter:
        return MessageWriter(boot, numbers, self._layout)

    def written(self, kind: str, n: int) -> Record:
        """A message of a kind; n: samples of a frame."""
        message_writer = self.outbox.message_writer
        time = self.now, self.now + 5
        if kind == "frame":
            codes = bytes([k & 0xFF for k in range(n)])
            patches = [[2, 0, 1, n, -4, 9, codes, {2: b"\1"}]]
            grids = [(0, 20000000, 9, 1, 0.5)]
            return message_writer.frame(
                0, self.now, time, grids, patches, samples=n, lasting=30000000
            )
        if kind == "statements":
            peak = 2, 0, time, CERTAIN, (1, 1), (0.5, 1.0), (0.25, float("inf")), 0.5
            verdict = "grip", time, 0, True, 0, 1.0
            return message_writer.statements(time, peaks=[peak], verdicts=[verdict])
        if kind == "status":
            usage = self.outbox.usage()
            return message_writer.status(time, "p", "", self.now, usage, 1)
        return Record(RESULT, self.outbox.next_sequence(), b"done" * n, time, 0)

    def say(self, *said: "Sequence[Any]") -> "list[int] | None":
        """Say messages in one batch; gives their numbers, or None if they could not be kept."""
        try:
            with self.outbox.batch() as batch:
                for kind, n in said:
                    batch.take([self.written(kind, n)])
        except OSError:
            return None
        return [record.sequence for record in batch.records]

    def wear_out(self) -> None:
        """From here on the chip fails."""
        self.chip.failing = True

    def repair(self) -> None:
        """The chip works again."""
        self.chip.failing = False

    def wait(self, time: int) -> None:
        """Let time pass."""
        self.now += time

    def restart(self) -> None:
        """Lose power and get it back."""
        self.chip.restart()
        self.outbox = self._made()

    def connect(self) -> None:
        """The radio has a connection."""
        self.outbox.connect(self.now)

    def status_is_due(self) -> bool:
        """Whether a status is to be recorded."""
        return self.outbox.is_status_due(self.now)

    def send(self, most: int) -> "list[list[Any]]":
        """What goes out now."""
        due = self.outbox.due(self.now, most)
        return [[list(kept.position), kept.kind, kept.body.hex()] for kept in due]

    def leave(self, boot: int, first: int, last: int) -> None:
        """The radio is rid of messages."""
        for sequence in range(first, last + 1):
            self.outbox.mark_sent((boot, sequence), self.now)

    def acknowledge(self, *spans: "Sequence[int]") -> bool:
        """A gateway has messages; gives whether they could be forgotten."""
        named = [(span[0], span[1], span[2]) for span in spans]
        try:
            self.outbox.acknowledge(named)
        except OSError:
            return False
        return True


def deliver(job: "Mapping[str, Any]") -> "list[Any]":
    """Give what each step of a script answers, and what waits behind it."""
    delivery = Delivery(*job["limits"])
    stated: list[Any] = []
    for name, *given in job["script"]:
        stated.append(getattr(delivery, name)(*given))
        outbox = delivery.outbox
        stated.append([list(outbox.usage()), list(outbox.held()), outbox.newest_status])
    waiting = delivery.chip.after((-1, -1), 1000000)
    stated.append([kept.body.hex() for kept in waiting])
    return stated
