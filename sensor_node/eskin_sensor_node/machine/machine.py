"""The emulated microcontroller: its events, its interrupts, its power, its resets.

Events happen in one order that never depends on real time.
"""

from __future__ import annotations

import heapq
import logging
from typing import TYPE_CHECKING, Final

from eskin.wire.messages import ResetCause
from eskin_sensor_node.machine.ledger import Ledger
from eskin_sensor_node.machine.outputs import Outputs

if TYPE_CHECKING:
    from collections.abc import Callable


log = logging.getLogger(__name__)

START_UP: Final = 20_000_000
"""ns from a reset to the firmware's first instruction: supply and oscillator settle, ROM loads."""
NEVER: Final = 1 << 62
"""ns; later than any event."""


class Timer:
    """A one-shot or periodic timer.

    Attributes:
        time: Machine time in ns at which it fires next.
        period: ns between two firings; 0: it fires once.
        action: What it does.
        running: Whether it will fire.
    """

    __slots__ = ("_order", "action", "period", "running", "time")

    def __init__(self, action: Callable[[], None], period: int) -> None:
        self.action = action
        self.period = period
        self.time = 0
        self.running = False
        self._order = -1

    def arm(self, time: int, order: int) -> None:
        """Fire at an instant; of events at one instant, the first armed comes first."""
        self.time, self._order, self.running = time, order, True

    @property
    def place(self) -> tuple[int, int]:
        """Its order of firing: it fires before all with a greater place."""
        return self.time, self._order

    def stop(self) -> None:
        """Fire no more."""
        self.running = False

    def stands_for(self, order: int) -> bool:
        """Whether an entry of the queue is the one that counts."""
        return self.running and self._order == order


class EventQueue:
    """Events by time and, at one time, in the order of their scheduling.

    Attributes:
        now: Machine time in ns: that of the latest event.
    """

    def __init__(self) -> None:
        self.now = 0
        self._order = 0
        self._heap: list[tuple[int, int, Timer]] = []

    def at(self, time: int, action: Callable[[], None]) -> Timer:
        """Do something once, at a machine time in ns; a time that is over means now."""
        timer = Timer(action, 0)
        self.arm(timer, time)
        return timer

    def every(self, period: int, action: Callable[[], None]) -> Timer:
        """Do something every ``period`` ns from now on, first one period from now."""
        if period <= 0:
            raise ValueError(f"a period of {period} ns; it must be positive")
        timer = Timer(action, period)
        self.arm(timer, self.now + period)
        return timer

    def arm(self, timer: Timer, time: int) -> None:
        """Let a timer fire at a machine time in ns instead of any other."""
        self._order += 1
        timer.arm(max(time, self.now), self._order)
        heapq.heappush(self._heap, (timer.time, self._order, timer))

    @property
    def next_due(self) -> int:
        """Machine time of the next event in ns; `NEVER` without one."""
        heap = self._heap
        while heap and not heap[0][2].stands_for(heap[0][1]):
            heapq.heappop(heap)
        return heap[0][0] if heap else NEVER

    def step(self) -> None:
        """Do what comes next; there must be something."""
        time, _, timer = heapq.heappop(self._heap)
        self.now = time
        if timer.period:
            self.arm(timer, time + timer.period)
        else:
            timer.stop()
        timer.action()

    def pass_to(self, time: int) -> None:
        """Let time pass up to an instant before which nothing is due."""
        self.now = max(self.now, time)


class Machine:
    """Runs events one after the other; a reset stops those of the firmware, and starts it anew.

    Hardware (supply, radio) puts its timers into `events`, where they go on through every reset.
    The firmware's interrupts are timers, too; a reset clears them.

    Args:
        timeout: ns after its last kick at which the watchdog resets the machine.
        clock_hz: Cycles of its processor a second.

    Attributes:
        events: Everything that is going to happen, in machine time: nominal ns since the
            emulation began.
        on: Whether the firmware has power.
        cause: Why it started last.
        booted: Machine time of that start.
        stopped: Machine time at which it stopped before.
        resets: How often it was reset.
        ledger: What it has done.
        outputs: What it drives.
        starting: Whether the firmware is to start before the next event.
    """

    def __init__(self, *, timeout: int, clock_hz: int) -> None:
        self.events = EventQueue()
        self.ledger = Ledger(clock_hz)
        self.outputs = Outputs()
        self.on = False
        self.cause = ResetCause.POWER_ON
        self.booted = self.stopped = 0
        self.resets = 0
        self.starting = False
        self._timeout = timeout
        self._kicked = 0
        self._hung: int | None = None
        self._interrupts: set[Timer] = set()
        self._watchdog = Timer(self._bite, 0)
        self._start_up = Timer(self.power_on, 0)

    @property
    def now(self) -> int:
        """Machine time in ns."""
        return self.events.now

    @property
    def running(self) -> bool:
        """Whether the firmware has power and does not hang."""
        return bool(self._interrupts)

    def reset(self, cause: ResetCause, lasting: int = START_UP) -> None:
        """Stop the firmware at once; it starts ``lasting`` ns later, with nothing in its RAM."""
        self.power_off(cause)
        self.events.arm(self._start_up, self.now + lasting)

    def power_off(self, cause: ResetCause) -> None:
        """Stop the firmware at once, until `power_on`; ``cause`` is what its next boot reports."""
        self._start_up.stop()
        self.starting = False
        self.cause = cause
        if not self.on:
            return
        if self._hung is not None:
            self.ledger.charge_hang(self.now - self._hung)
        self._clear()
        self._watchdog.stop()
        self.outputs.release(self.now)
        self.on = False
        self.stopped = self.now
        self.resets += 1
        log.warning("machine stops: cause=%s at_s=%.3f", cause.label, self.now / 1e9)

    def power_on(self) -> None:
        """Let the firmware start now, with nothing in its RAM."""
        if not self.on:
            self._start_up.stop()
            self.starting = True

    def boot(self) -> None:
        """Start the firmware; called between two events."""
        self.ledger.charge_off(self.now - self.stopped)
        self.on, self.starting, self._hung = True, False, None
        self.booted = self._kicked = self.now
        self.events.arm(self._watchdog, self.now + self._timeout)
        # Where nothing else wakes the firmware in time, this does.
        self.interrupt_every(self._timeout // 2, self.kick)

    def interrupt(self, action: Callable[[], None]) -> Timer:
        """A timer of the firmware, not yet armed; a reset clears it."""
        timer = Timer(action, 0)
        self._interrupts.add(timer)
        return timer

    def arm(self, timer: Timer, time: int) -> None:
        """Let an interrupt come at a machine time; not after the firmware has stopped."""
        if timer in self._interrupts:
            self.events.arm(timer, time)

    def interrupt_every(self, period: int, action: Callable[[], None]) -> Timer:
        """A periodic timer of the firmware, in ns; a reset clears it."""
        timer = self.events.every(period, action)
        self._interrupts.add(timer)
        return timer

    def kick(self) -> None:
        """Kick the watchdog."""
        self._kicked = self.now

    def halt(self) -> None:
        """Ignore interrupts, as a processor that hangs; the watchdog runs on."""
        self._hung = self.now
        self._clear()

    def run(self, time: int, most: int) -> None:
        """Run at most so many events up to a machine time, and stop where the firmware starts."""
        events = self.events
        for _ in range(most):
            if self.starting or events.next_due > time:
                return
            events.step()

    def _bite(self) -> None:
        due = self._kicked + self._timeout
        if self.now < due:
            self.events.arm(self._watchdog, due)
        else:
            self.reset(ResetCause.WATCHDOG)

    def _clear(self) -> None:
        for timer in self._interrupts:
            timer.stop()
        self._interrupts.clear()
