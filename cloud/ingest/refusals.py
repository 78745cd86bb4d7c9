"""Log lines about refused messages, so few that a node of which all is refused fills no disk."""

from __future__ import annotations

import logging
import time
from collections import Counter
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

log = logging.getLogger(__name__)

_EVERY_S: Final = 1.0


class Refusals:
    """Tells of each gateway's refused messages at most once a second, and how many there were.

    Each has its reason in the answer and among the dead letters. On the event loop only.

    Args:
        clock: Monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._told: dict[str, float] = {}
        self._untold: Counter[str] = Counter()

    def tell(self, gateway: str, reasons: Sequence[str]) -> None:
        """Tell of some that were refused, now or with later ones.

        Args:
            gateway: Who brought them.
            reasons: Why, of each.
        """
        if not reasons:
            return
        self._untold[gateway] += len(reasons)
        now = self._clock()
        if now < self._told.get(gateway, float("-inf")) + _EVERY_S:
            return
        self._told[gateway] = now
        count = self._untold.pop(gateway)
        log.warning("messages rejected: gateway=%s count=%d last=%s", gateway, count, reasons[-1])
