"""What the machine has done, span by span: the sums that its energy follows from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sensor_node.machine.work import Work

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sensor_node.firmware.schedule import Frame

CLOCK_HZ: Final = 160_000_000
"""Of the processor: a Cortex-M33 as in an STM32U575 (ST, DS13737)."""
_CONVERSION_NS: Final = 1_000
"""Awake for one conversion: sampling, and 14 bits at 2.5 million a second."""
REPEAT_NS: Final = 5_000 + _CONVERSION_NS
"""Awake for a conversion of what is held with another range: the amplifier settles (assumed)."""
WAKE_NS: Final = 20_000
"""Awake for one wake-up from deep sleep: regulator and clock (assumed)."""
OF_INTERRUPT: Final = 200
"""Instructions of an interrupt: entry, taking codes out of a buffer, exit (assumed)."""
INTERRUPT_NS: Final = OF_INTERRUPT * 1_000_000_000 // CLOCK_HZ
"""Awake for them."""
OPERATION: Final = 60
"""Instructions of one operation on binary64 in software: loads, call, arithmetic, stores."""
OPERATIONS: Final = {
    "capacitive": 69,
    "touch": 121,
    "inductive": 267,
    "hybrid": 134,
    "pad": 183,
    "neighbour": 10,
    "remembered": 13,
    "new": 24,
    "coil": 556,
    "thermometer": 625,
    "hygrometer": 137,
    "bioelectric": 67,
}
"""Operations and comparisons with one sample at most, counted: of each chain's inversion; of a pad
besides, for each neighbour whose pressure is known, for each sensor of the air that is read along,
and where its code is new, after its chain's inversion."""
OF_CHANNEL: Final = 40
"""The same for each channel: rest, two passes for peaks, encoding."""
OF_FRAME: Final = 40_000
"""Instructions of a frame besides: messages, flash driver."""


def operations(chain: str, n: int, neighbours: int, new: Mapping[str, int]) -> int:
    """Of the inversion of a frame.

    Args:
        chain: The taxel's.
        n: Samples.
        neighbours: How many were measured at the same instants.
        new: Of each sensor that is read along, its chain, and how many codes were new.
    """
    known = OPERATIONS["neighbour"] * neighbours + OPERATIONS["remembered"] * len(new)
    inverted = sum(times * (OPERATIONS[each] + OPERATIONS["new"]) for each, times in new.items())
    return n * (OPERATIONS[chain] + known) + inverted


class Ledger:
    """Sums, from which spans are taken one after the other.

    It charges a frame when it is complete. Time awake that a span cannot hold goes into the next.

    Attributes:
        sent: Bytes given to the radio since the beginning, with repeats; the radio adds to it,
            also from a thread of its own, and nobody else changes it.
        received: Likewise, what it received.
    """

    def __init__(self) -> None:
        self.sent = self.received = 0
        self._taken = 0, 0
        self._instructions = self._conversions = self._wakes = 0
        self._awake = self._off = self._begin = 0

    def charge_frame(self, frame: Frame, *, operations: int, inputs: int, channels: int) -> None:
        """Count a frame that was sampled and worked off.

        Args:
            frame: Which one.
            operations: Of its inversion.
            inputs: Conversions of a sample.
            channels: Blocks that it makes.
        """
        instructions = OF_FRAME + (operations + frame.n * OF_CHANNEL * channels) * OPERATION
        self._instructions += instructions
        self._conversions += frame.n * inputs
        sampling = frame.n * min(frame.dt, inputs * _CONVERSION_NS)
        self._awake += sampling + instructions * 1_000_000_000 // CLOCK_HZ

    def charge_interrupt(self, times: int = 1) -> None:
        """Count wake-ups of the processor, and the handler of what woke it."""
        self._wakes += times
        self._instructions += times * OF_INTERRUPT
        self._awake += times * (WAKE_NS + INTERRUPT_NS)

    def charge_repeats(self, samples: int, conversions: int) -> None:
        """Count samples that were converted again: an interrupt each, and how often in all."""
        self.charge_interrupt(samples)
        self._conversions += conversions
        self._awake += conversions * REPEAT_NS

    def charge_hang(self, span: int) -> None:
        """Count ns in which the processor went round in circles."""
        self._awake += span
        self._instructions += span * CLOCK_HZ // 1_000_000_000

    def charge_off(self, span: int) -> None:
        """Count ns without power or before the firmware starts."""
        self._off += span

    def take(self, now: int) -> Work:
        """What was done since the last time, up to a machine time in ns."""
        span = now - self._begin
        free = max(0, span - self._off)
        awake = min(free, self._awake)
        traffic = self.sent, self.received
        sent, received = (all_ - taken for all_, taken in zip(traffic, self._taken, strict=True))
        work = Work(
            self._instructions,
            self._conversions,
            sent,
            received,
            free - awake,
            span,
            wakes=self._wakes,
        )
        self._instructions = self._conversions = self._wakes = 0
        self._taken = traffic
        self._awake -= awake
        self._off -= min(self._off, span)
        self._begin = now
        return work
