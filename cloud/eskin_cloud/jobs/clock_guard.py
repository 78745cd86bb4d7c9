"""The time that retention goes by: it does not follow a clock that leaps ahead."""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.wire.timestamp import SECOND
from eskin_cloud.store.write.clock_state import ClockReading

if TYPE_CHECKING:
    from collections.abc import Callable

log = logging.getLogger(__name__)

LEAP: Final = 3600 * SECOND
"""No clock that is followed by NTP goes ahead by so much at once."""
DOUBT: Final = 86_400 * SECOND
"""For so long a leap is not believed: time to set a clock right that went wrong."""
ABSENCE: Final = 86_400 * SECOND
"""A cloud that was off for longer, by its clock, may have a clock that is wrong."""


def _ticks() -> int:
    """Ns since the machine started; also while it sleeps."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


class _Doubt(NamedTuple):
    """A later time that the clock shows, and that is not believed.

    Attributes:
        since: When that began, in ticks.
        ahead: The clock less the ticks.
    """

    since: int
    ahead: int


class ClockGuard:
    """Follows a clock, but where it leaps ahead, what has passed in truth for a day.

    What is removed does not come back, so a clock that went wrong by a year for a minute must not
    remove a year; nor must one that is wrong when the cloud starts. One that is set back is
    followed at once: less is removed by it.

    Args:
        clock: UTC ns.
        ticks: Ns that passed, since any instant.
        last: What the cloud went by when it ran last; without it, what the clock says is believed.
    """

    def __init__(
        self,
        clock: Callable[[], int],
        *,
        ticks: Callable[[], int] = _ticks,
        last: ClockReading | None = None,
    ) -> None:
        self._clock = clock
        self._ticks = ticks
        self._ahead = clock() - ticks()
        self._doubt: _Doubt | None = None
        if last is not None:
            self._go_on(last)

    def __call__(self) -> int:
        """UTC ns."""
        ticks = self._ticks()
        ahead = self._clock() - ticks
        if ahead <= self._ahead + LEAP:
            self._ahead, self._doubt = ahead, None
        elif self._doubt is None or ahead > self._doubt.ahead + LEAP:
            hours = (ahead - self._ahead) / LEAP
            log.warning("the clock leapt ahead by %.1f h: nothing is removed by it today", hours)
            self._doubt = _Doubt(ticks, ahead)
        elif ticks >= self._doubt.since + DOUBT:
            log.warning("the clock is believed again, a day after it leapt ahead")
            self._ahead, self._doubt = ahead, None
        return ticks + self._ahead

    def read(self) -> ClockReading:
        """What to go on from when the cloud starts again."""
        believed = self()
        if self._doubt is None:
            return ClockReading(believed)
        return ClockReading(
            believed, self._doubt.ahead - self._ahead, self._ticks() - self._doubt.since
        )

    def _go_on(self, last: ClockReading) -> None:
        """Doubt a clock that went on by more than a cloud is mostly off, or was in doubt before."""
        ticks, now = self._ticks(), self._clock()
        passed = now - last.believed
        if passed <= (LEAP if last.ahead else ABSENCE):
            return
        log.warning(
            "by its clock the cloud was off for %.1f days: nothing is removed by it until it ran "
            "for a day, in case that it is the clock",
            passed / ABSENCE,
        )
        again = last.ahead > 0 and passed <= last.ahead + ABSENCE
        self._ahead = last.believed - ticks
        self._doubt = _Doubt(ticks - last.doubted if again else ticks, now - ticks)
