"""The time by which things are removed: it does not follow a clock that leaps ahead."""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Final

from eskin.moment import SECOND

if TYPE_CHECKING:
    from collections.abc import Callable

log = logging.getLogger(__name__)

LEAP: Final = 3600 * SECOND
"""No clock that is followed by NTP goes ahead by so much at once."""
DOUBT: Final = 86_400 * SECOND
"""For so long a leap is not believed: time to set a clock right that went wrong."""


def _ticks() -> int:
    """Ns since the machine started; also while it sleeps."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


class Steady:
    """Follows a clock, but where it leaps ahead, what has passed in truth for a day.

    What is removed does not come back, so a clock that went wrong by a year for a minute must not
    remove a year. One that is set back is followed at once: less is removed by it.

    Args:
        clock: UTC ns; what it says at first is believed.
        ticks: Ns that passed, since whenever.
    """

    def __init__(self, clock: Callable[[], int], *, ticks: Callable[[], int] = _ticks) -> None:
        self._clock = clock
        self._ticks = ticks
        self._ahead = clock() - ticks()
        self._doubted: tuple[int, int] | None = None  # since when, and how far ahead

    def __call__(self) -> int:
        """UTC ns."""
        ticks = self._ticks()
        ahead = self._clock() - ticks
        if ahead <= self._ahead + LEAP:
            self._ahead, self._doubted = ahead, None
        elif self._doubted is None or ahead > self._doubted[1] + LEAP:
            hours = (ahead - self._ahead) / LEAP
            log.warning("the clock leapt ahead by %.1f h: nothing is removed by it today", hours)
            self._doubted = ticks, ahead
        elif ticks >= self._doubted[0] + DOUBT:
            log.warning("the clock is believed again, a day after it leapt ahead")
            self._ahead, self._doubted = ahead, None
        return ticks + self._ahead
