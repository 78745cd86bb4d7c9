"""The work that the machine has done, span by span: the basis of its energy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin_sensor_node.machine.prices import BILLION, NONE, PRICES, Cycles
from eskin_sensor_node.machine.work_counters import WorkCounters

if TYPE_CHECKING:
    from eskin_sensor_node.firmware.schedule import Frame

CONVERSION_NS: Final = 1_000
"""Awake for one conversion: sampling, and 14 bits at 2.5 million a second."""
REPEAT_NS: Final = 5_000 + CONVERSION_NS
"""Awake for a conversion of what is held with another range: the amplifier settles (assumed)."""
WAKE_NS: Final = 20_000
"""Awake for one wake-up from deep sleep: regulator and clock (assumed)."""
OVERHEAD: Final = 64
"""Bytes of flash that a message takes besides its own: its place and time, salt and tag."""
INTERRUPT_NS: Final = PRICES["interrupt"].span(160_000_000)
"""Awake for an interrupt's handler, with the default clock."""


class Ledger:
    """Sums, from which spans are taken one after the other.

    It charges a frame when it is complete. Time awake that a span cannot hold goes into the next.

    Args:
        clock_hz: Cycles of the processor a second.

    Attributes:
        sent: Bytes given to the radio since the beginning, with repeats; the radio adds to it,
            also from a thread of its own.
        received: Likewise, what it received.
    """

    def __init__(self, clock_hz: int) -> None:
        self._clock_hz = clock_hz
        self.sent = self.received = 0
        self._taken = 0, 0
        self._cycles = NONE
        self._conversions = self._wakes = self._written = 0
        self._awake = self._off = self._begin = 0

    def charge_frame(self, frame: Frame, *, cycles: Cycles, inputs: int) -> None:
        """Count a frame that was sampled and worked off.

        Args:
            frame: Which one.
            cycles: What was done with it.
            inputs: Conversions of a sample.
        """
        self._charge(cycles.plus(PRICES["frame"]))
        self._conversions += frame.n * inputs
        self._awake += frame.n * min(frame.dt, inputs * CONVERSION_NS)

    def charge_message(self, cycles: Cycles, size: int) -> None:
        """Count a message of so many bytes that is written, and kept in flash."""
        self._charge(cycles)
        self._written += size + OVERHEAD

    def charge_interrupt(self, times: int = 1) -> None:
        """Count wake-ups of the processor, and the handler of what woke it."""
        self._wakes += times
        self._awake += times * WAKE_NS
        self._charge(PRICES["interrupt"].times(times))

    def charge_work(self, cycles: Cycles) -> None:
        """Count other work of the processor."""
        self._charge(cycles)

    def charge_repeats(self, samples: int, conversions: int) -> None:
        """Count samples that were converted again: an interrupt each, and how often in all."""
        self.charge_interrupt(samples)
        self._conversions += conversions
        self._awake += conversions * REPEAT_NS

    def charge_hang(self, span: int) -> None:
        """Count ns in which the processor hung in a loop."""
        cycles = span * self._clock_hz // BILLION
        self._charge(Cycles(cycles, cycles))

    def charge_off(self, span: int) -> None:
        """Count ns without power or before the firmware starts."""
        self._off += span

    def _charge(self, cycles: Cycles) -> None:
        self._cycles = self._cycles.plus(cycles)
        self._awake += cycles.span(self._clock_hz)

    def take(self, now: int) -> WorkCounters:
        """What was done since the last time, up to a machine time in ns."""
        span = now - self._begin
        on = max(0, span - self._off)
        awake = min(on, self._awake)
        traffic = self.sent, self.received
        sent, received = (all_ - taken for all_, taken in zip(traffic, self._taken, strict=True))
        work = WorkCounters(
            cycles=self._cycles.most,
            conversions=self._conversions,
            sent=sent,
            received=received,
            written=self._written,
            wakes=self._wakes,
            fewest=self._cycles.least,
            asleep=on - awake,
            on=on,
            span=span,
        )
        self._cycles = NONE
        self._conversions = self._wakes = self._written = 0
        self._taken = traffic
        self._awake -= awake
        self._off -= min(self._off, span)
        self._begin = now
        return work
