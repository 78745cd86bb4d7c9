"""The machine's events: what happens when, in one order that never depends on real time."""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

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
        """Fire at a moment; of events at one moment, the one that was armed first comes first."""
        self.time, self._order, self.running = time, order, True

    @property
    def place(self) -> tuple[int, int]:
        """Before whom it fires: all with a greater place."""
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
        """Let time pass up to a moment before which nothing is due."""
        self.now = max(self.now, time)
