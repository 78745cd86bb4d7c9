"""The machine's crystal and clock: emulated time, and what the firmware reads of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin_sensor_node.firmware.clock import Clock as FirmwareClock
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.firmware.schedule import Frame


_STEADY: Final = 0.6
"""Share of the data sheet's bound that cutting and ageing take; temperature takes the rest."""
_SWING_NS: Final = 1.8e12
"""How fast its temperature follows the room's: half an hour."""


class Crystal:
    """A quartz crystal: turns ticks (nominal ns) into true ns.

    The rate error is a constant plus a swing with the temperature, together within the bound.

    Args:
        drift: Greatest rate error, in parts of 1e9.
        random: Draws the true one.
    """

    def __init__(self, drift: int, random: np.random.Generator) -> None:
        self._steady = _STEADY * drift * random.uniform(-1.0, 1.0) / BILLION
        self._swing = (1.0 - _STEADY) * drift * random.uniform(-1.0, 1.0) / BILLION
        self._pace = 2.0 * math.pi / _SWING_NS

    def elapsed(self, ticks: NDArray[np.int64] | int) -> NDArray[np.int64]:
        """True ns since the start, when the crystal has counted these ticks."""
        nominal = np.asarray(ticks, dtype=np.float64)
        swing = self._swing * (1.0 - np.cos(self._pace * nominal)) / self._pace
        # Toward the nominal: rounding must not carry it past the bound.
        return np.asarray(ticks) + np.trunc(self._steady * nominal + swing).astype(np.int64)


class Clock:
    """Emulated time: starts at the present and runs ``speed`` times as fast as real time.

    The real-time clock that was read at the start was wrong by a true offset inside its bound,
    which the node does not know; nor does it know how wrong its crystal is.

    A reset of the machine starts the count of ticks anew, with a new reading.

    Args:
        start: True UTC at the start, ns since 1970.
        monotonic: Real time in ns from any origin.
        speed: Emulated seconds in a real second.
        rtc_error: Bound of the real-time clock's error, in ns.
        drift: Bound of the crystal's rate error, in parts of 1e9.
        crystal: The crystal.
        random: Draws the true offset.
        origin: Real time at the start, ns; ``None``: now.
    """

    def __init__(
        self,
        *,
        start: int,
        monotonic: Callable[[], int],
        speed: float,
        rtc_error: int,
        drift: int,
        crystal: Crystal,
        random: np.random.Generator,
        origin: int | None = None,
    ) -> None:
        self._start = start
        self._monotonic = monotonic
        self._origin = monotonic() if origin is None else origin
        self._speed = speed
        self._crystal = crystal
        self._rtc_error = rtc_error
        self._drift = drift
        self._booted = 0
        self.lived = 0
        """True ns of the emulated world before the machine's latest start."""
        self._read(random)

    def restart(self, time: int, random: np.random.Generator) -> None:
        """Count from 0 again at a machine time; ``random`` draws the new reading's true error."""
        true = int(self._crystal.elapsed(time - self._booted))
        self._start += true
        self.lived += true
        self._booted = time
        self._read(random)

    def now(self) -> int:
        """Machine time: emulated ns since the emulation began, as the crystal counts them."""
        return int((self._monotonic() - self._origin) * self._speed)

    def ticks(self) -> int:
        """The same since the machine's latest start."""
        return self.now() - self._booted

    def elapsed(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """True ns since the machine's latest start."""
        return self._crystal.elapsed(ticks)

    def seconds(self, frame: Frame, *, triggered: bool) -> Floats:
        """True seconds of a frame's samples.

        Args:
            frame: Whose.
            triggered: Whether they count from the trigger of its burst; else, from when the
                emulation began.
        """
        since = self.elapsed(frame.start + frame.dt * np.arange(frame.n, dtype=np.int64))
        origin = self.elapsed(np.asarray(frame.trigger)) if triggered else -self.lived
        return np.asarray((since - origin) / BILLION)

    def true_time(self, ticks: int) -> int:
        """True UTC in ns; for the audit, not for the firmware."""
        return self._start + int(self._crystal.elapsed(ticks))

    def seconds_until(self, time: int) -> float:
        """Real seconds until a machine time; negative when it is over."""
        return (time - self.now()) / self._speed / BILLION

    def _read(self, random: np.random.Generator) -> None:
        error = self._rtc_error
        reading = self._start + int(random.integers(-error, error, endpoint=True))
        self.known = FirmwareClock(reading, error, self._drift)
        """What the firmware knows."""
