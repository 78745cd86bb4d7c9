"""Sampling interrupts: when the processor is woken, and with which latency.

A timer starts each conversion, so samples are taken in time while the processor sleeps. DMA puts
their codes into a buffer; when it is full, an interrupt wakes the processor, which must take them
out before the next codes come. By default the buffer is a frame's, and there are two of them.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final

from eskin.errors import SettingsError
from eskin_sensor_node.firmware.autoranging import MOST
from eskin_sensor_node.kinds.settings import period
from eskin_sensor_node.machine.ledger import INTERRUPT_NS, REPEAT_NS, WAKE_NS
from eskin_sensor_node.machine.machine import NEVER

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.machine.machine import Machine
    from eskin_sensor_node.settings import NodeSettings

WHOLE_FRAME: Final = 0
"""Depth of a buffer that holds a frame, whatever its length."""


def most_latency(taxels: int) -> int:
    """From an interrupt to its handler, ns at most: the wake-up, and the handlers of all others."""
    return WAKE_NS + (taxels - 1) * INTERRUPT_NS


def most_repeats(settings: NodeSettings, taxel: TaxelSection) -> int:
    """How often a taxel's samples can be converted again before the next ones come.

    All taxels may saturate at one instant, and one after the other is served.
    """
    inputs = sum(each.firmware.amplified for each in settings.taxel)
    free = period(taxel.sampling) - most_latency(len(settings.taxel)) - INTERRUPT_NS
    return max(0, min(MOST, free // (inputs * REPEAT_NS)))


def require_depth(settings: NodeSettings) -> None:
    """Check that no buffer overflows before the processor handles it.

    Raises:
        SettingsError: There is one.
    """
    depth, latency = settings.machine.dma_samples, most_latency(len(settings.taxel)) + INTERRUPT_NS
    if depth == WHOLE_FRAME:
        return
    dt, name = min((period(taxel.sampling), taxel.id) for taxel in settings.taxel)
    if depth * dt <= latency:
        raise SettingsError(
            "machine.dma_samples",
            f"{depth} is not allowed: {name} gives a code every {dt} ns, and it may take "
            f"{latency} ns until they are out; use at least {latency // dt + 1}, or {WHOLE_FRAME}",
        )


class SamplingInterrupts:
    """Interrupts of all taxels: those in a frame, and the one that completes it.

    Args:
        machine: Whose they are.
        actions: What is to be done when a frame of each taxel is complete.
        depth: Samples that a buffer holds; `WHOLE_FRAME` for all of a frame.

    Attributes:
        latencies: ns from an interrupt to its handler, least and greatest of each taxel so far.
    """

    def __init__(self, machine: Machine, actions: Sequence[Callable[[], None]], depth: int) -> None:
        self._machine = machine
        self._depth = depth
        self._busy = 0
        self.latencies = [(NEVER, 0) for _ in actions]
        self._complete = [machine.interrupt(action) for action in actions]
        self._inside = [
            machine.interrupt(partial(self._empty, number)) for number in range(len(actions))
        ]
        self._frames: list[Frame | None] = [None] * len(actions)

    @property
    def due(self) -> int:
        """Machine time in ns at which a frame is complete next; `NEVER` while all rest."""
        return min((timer.time for timer in self._complete if timer.running), default=NEVER)

    @property
    def order(self) -> list[int]:
        """Numbers of all taxels as their next frames will be complete."""
        return sorted(range(len(self._complete)), key=lambda k: self._complete[k].place)

    def arm(self, number: int, frame: Frame) -> None:
        """Sample a taxel's next frame."""
        self._frames[number] = frame
        self._machine.arm(self._complete[number], self._machine.booted + frame.due)
        self._arm_inside(number, frame)

    def complete(self, number: int) -> None:
        """Handle the interrupt after a frame's last sample."""
        self._handle(number)

    def handle(self, span: int) -> int:
        """Handle another interrupt, which takes a span of ns; gives ns until that is done."""
        begin = self._begin()
        self._busy = begin + INTERRUPT_NS + span
        self._machine.ledger.charge_interrupt()
        return self._busy - self._machine.now

    def stop(self) -> None:
        """Stop sampling."""
        for timer in (*self._complete, *self._inside):
            timer.stop()

    def _empty(self, number: int) -> None:
        """Take a part of a frame out of the buffer."""
        self._handle(number)
        frame = self._frames[number]
        if frame is not None:
            self._arm_inside(number, frame)

    def _arm_inside(self, number: int, frame: Frame) -> None:
        """Await the next full buffer in a frame; the last one comes with the frame's end."""
        if self._depth == WHOLE_FRAME:
            return
        machine, span = self._machine, self._depth * frame.dt
        since = max(0, machine.now - machine.booted - frame.start)
        due = frame.start + (since // span + 1) * span
        if due < frame.end:
            machine.arm(self._inside[number], machine.booted + due)
        else:
            self._inside[number].stop()

    def _handle(self, number: int) -> None:
        machine, begin = self._machine, self._begin()
        self._busy = begin + INTERRUPT_NS
        least, most = self.latencies[number]
        latency = begin - machine.now
        self.latencies[number] = min(least, latency), max(most, latency)
        machine.ledger.charge_interrupt()

    def _begin(self) -> int:
        """When a handler begins whose interrupt comes now."""
        now = self._machine.now
        return now + WAKE_NS if now >= self._busy else self._busy
