"""The machine's crystal and clock: emulated time, and what the firmware reads of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin_sensor_node.firmware.clock import Clock as FirmwareClock
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.firmware.schedule import Frame


_NUMBER: Final = 1 << 30
"""The clock's among the taxels that draw something."""
_STEADY: Final = 0.6
"""Share of the data sheet's bound that cutting and ageing take; temperature takes the rest."""
_SWING_NS: Final = 1.8e12
"""How fast its temperature follows the room's: half an hour."""


class Crystal:
    """Quartz crystals of some nodes, a column each: turn ticks (nominal ns) into true ns.

    The rate error is a constant plus a swing with the temperature, together within the bound.

    Args:
        drift: Greatest rate error, in parts of 1e9.
        random: Draws the true ones, see `clock_generator`.
    """

    def __init__(self, drift: int, random: ColumnGenerator) -> None:
        self._steady = _STEADY * drift * random.uniform(-1.0, 1.0) / BILLION
        self._swing = (1.0 - _STEADY) * drift * random.uniform(-1.0, 1.0) / BILLION
        self._pace = 2.0 * math.pi / _SWING_NS

    def elapsed(self, ticks: NDArray[np.int64] | int) -> NDArray[np.int64]:
        """True ns since the start, when the crystals have counted these ticks: columns × ticks."""
        nominal = np.asarray(ticks, dtype=np.float64)
        swing = self._swing * (1.0 - np.cos(self._pace * nominal)) / self._pace
        # Toward the nominal: rounding must not carry it past the bound.
        return np.asarray(ticks) + np.trunc(self._steady * nominal + swing).astype(np.int64)


def clock_generator(seeds: ArrayLike) -> ColumnGenerator:
    """What draws crystals and readings of nodes with some seeds."""
    return ColumnGenerator(seeds, _NUMBER)


def draw_offsets(error: int, random: ColumnGenerator, boots: ArrayLike) -> NDArray[np.int64]:
    """How wrong the readings at some nodes' starts are, within a bound, ns."""
    random.begin(boots, np.zeros(1, np.int64))
    return np.rint(random.uniform(-error, error)[:, 0]).astype(np.int64)


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
        seed: The node's; it draws the crystal.
        boot: Number of this start; it draws the true offset.
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
        seed: int,
        boot: int,
        origin: int | None = None,
    ) -> None:
        self._start = start
        self._monotonic = monotonic
        self._origin = monotonic() if origin is None else origin
        self._speed = speed
        self._random = clock_generator(seed)
        self._crystal = Crystal(drift, self._random)
        self._rtc_error = rtc_error
        self._drift = drift
        self._booted = 0
        self.lived = 0
        """True ns of the emulated world before the machine's latest start."""
        self._read(boot)

    def restart(self, time: int, boot: int) -> None:
        """Count from 0 again at a machine time; the boot draws the new reading's true error."""
        true = self._crystal.elapsed(time - self._booted).item()
        self._start += true
        self.lived += true
        self._booted = time
        self._read(boot)

    def now(self) -> int:
        """Machine time: emulated ns since the emulation began, as the crystal counts them."""
        return int((self._monotonic() - self._origin) * self._speed)

    def ticks(self) -> int:
        """The same since the machine's latest start."""
        return self.now() - self._booted

    def elapsed(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """True ns since the machine's latest start."""
        found: NDArray[np.int64] = self._crystal.elapsed(ticks)[0]
        return found

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
        return self._start + int(self._crystal.elapsed(ticks).item())

    def seconds_until(self, time: int) -> float:
        """Real seconds until a machine time; negative when it is over."""
        return (time - self.now()) / self._speed / BILLION

    def _read(self, boot: int) -> None:
        error = self._rtc_error
        reading = self._start + int(draw_offsets(error, self._random, boot).item())
        self.known = FirmwareClock(reading, error, self._drift)
        """What the firmware knows."""
