"""Log lines about bad messages, so few that a flood cannot fill the disk."""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin.errors import EskinError
    from gateway.reason import Reason

log = logging.getLogger(__name__)

WINDOW_S: Final = 10.0
BURST: Final = 5


class Complaints:
    """At most `BURST` lines for each reason in `WINDOW_S` seconds; the rest is counted.

    Args:
        clock: Monotonic seconds.
    """

    def __init__(self, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._windows: dict[Reason, tuple[float, int]] = {}

    def say(self, reason: Reason, *, topic: str, error: EskinError) -> None:
        """Log one refusal, or count it."""
        now = self._clock()
        start, said = self._windows.get(reason, (now, 0))
        if now >= start + WINDOW_S:
            self._tell_silenced(reason, said)
            start, said = now, 0
        self._windows[reason] = start, said + 1
        if said < BURST:
            # repr keeps line breaks and control characters of strangers out of the log.
            log.warning(
                "message rejected: reason=%s topic=%r error=%r", reason, topic[:200], str(error)
            )

    def settle(self) -> None:
        """Tell of windows that have ended; called now and then."""
        now = self._clock()
        for reason, (start, said) in list(self._windows.items()):
            if now >= start + WINDOW_S:
                self._tell_silenced(reason, said)
                del self._windows[reason]

    def _tell_silenced(self, reason: Reason, said: int) -> None:
        if said > BURST:
            log.warning("messages rejected: reason=%s more=%d", reason, said - BURST)
