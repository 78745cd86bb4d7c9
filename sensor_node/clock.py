"""The node's clock: ticks since its start, and an enclosure of their UTC time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sensor_node.constants import SECOND

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np


class Clock:
    """Emulated time: starts at the present and runs ``speed`` times as fast as real time.

    The crystal is exact; the real-time clock that was read at the start was wrong by a true offset
    inside its bound, which the node does not know.

    Args:
        start: True UTC at the start, ns since 1970.
        monotonic: Real time in ns from any origin.
        speed: Emulated seconds in a real second.
        rtc_error: Bound of the real-time clock's error, in ns.
        random: Draws the true offset.
    """

    def __init__(
        self,
        *,
        start: int,
        monotonic: Callable[[], int],
        speed: float,
        rtc_error: int,
        random: np.random.Generator,
    ) -> None:
        self._start = start
        self._monotonic = monotonic
        self._origin = monotonic()
        self._speed = speed
        self._error = rtc_error
        self._reading = start + int(random.integers(-rtc_error, rtc_error, endpoint=True))

    def ticks(self) -> int:
        """Emulated ns since the start."""
        return int((self._monotonic() - self._origin) * self._speed)

    def true_time(self, ticks: int) -> int:
        """True UTC in ns; for the audit, not for the firmware."""
        return self._start + ticks

    def enclosure(self, ticks: int) -> tuple[int, int]:
        """Earliest and latest UTC in ns of a moment, as the firmware knows it."""
        middle = self._reading + ticks
        return middle - self._error, middle + self._error

    def seconds_until(self, ticks: int) -> float:
        """Real seconds until a moment; negative when it is over."""
        return (ticks - self.ticks()) / self._speed / SECOND
