"""What a gateway tells the cloud of itself, in the token of each request."""

from __future__ import annotations

from time import monotonic, time_ns
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

    from gateway.presence import Presence
    from gateway.spool import Spool

_FRESH_S: Final = 0.5
"""What was looked up is told for so long: a look waits for the spool's commit."""


class Condition:
    """Looks at the spool, now and then.

    Args:
        spool: What waits.
        presence: Which nodes are heard.
        clock: Monotonic seconds.
        now: UTC ns.
    """

    def __init__(
        self,
        spool: Spool,
        presence: Presence,
        *,
        clock: Callable[[], float] = monotonic,
        now: Callable[[], int] = time_ns,
    ) -> None:
        self._spool = spool
        self._presence = presence
        self._clock = clock
        self._now = now
        self._seen: tuple[float, dict[str, int | None]] | None = None

    def __call__(self) -> dict[str, int | None]:
        """Messages and bytes that wait, since when in ns, and how many nodes are heard.

        Raises:
            SpoolError: The spool cannot be read.
        """
        at = self._clock()
        if self._seen is None or at - self._seen[0] > _FRESH_S:
            self._seen = at, self._look()
        return self._seen[1]

    def _look(self) -> dict[str, int | None]:
        spool, oldest = self._spool.statistics, self._spool.oldest()
        return {
            "messages": spool.messages,
            "bytes": spool.used,
            "capacity_bytes": spool.capacity,
            "oldest_ns": None if oldest is None else max(0, self._now() - oldest),
            "dead_letters": spool.dead_letters,
            "nodes": self._presence.online,
        }
