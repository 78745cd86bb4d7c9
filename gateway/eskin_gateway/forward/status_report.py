"""The gateway's report of its own status: headers of each request to the cloud."""

from __future__ import annotations

from time import monotonic, time_ns
from typing import TYPE_CHECKING, Final

import orjson

from eskin.errors import SpoolError

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_gateway.publish.presence import Presence
    from eskin_gateway.spool.spool import Spool

HEADER: Final = "Eskin-Gateway-Status"
_FRESH_S: Final = 0.5
"""What was looked up is told for so long: a look waits for the spool's commit."""


class StatusReport:
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

    def headers(self) -> dict[str, str]:
        """Headers of a request whose body is CBOR, with the status where it can be had."""
        kind = {"Content-Type": "application/cbor"}
        at = self._clock()
        if self._seen is None or at - self._seen[0] > _FRESH_S:
            try:
                self._seen = at, self._look()
            except SpoolError:  # told by those who need the spool; the request goes out
                return kind
        return {**kind, HEADER: orjson.dumps(self._seen[1]).decode()}

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
