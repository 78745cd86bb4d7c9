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
_MAX_AGE_S: Final = 0.5
"""The report is cached, because reading the spool waits for its commit."""


class StatusReport:
    """Reports the state of spool and nodes.

    Args:
        spool: Holds messages for the cloud.
        presence: Knows which nodes are online.
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
        self._cached: tuple[float, dict[str, int | None]] | None = None

    def headers(self) -> dict[str, str]:
        """Headers of a request with a CBOR body, with the status if the spool can be read."""
        headers = {"Content-Type": "application/cbor"}
        at = self._clock()
        if self._cached is None or at - self._cached[0] > _MAX_AGE_S:
            try:
                self._cached = at, self._report()
            except SpoolError:  # the forwarder reports it
                return headers
        return {**headers, HEADER: orjson.dumps(self._cached[1]).decode()}

    def _report(self) -> dict[str, int | None]:
        spool, oldest = self._spool.statistics, self._spool.oldest()
        return {
            "messages": spool.messages,
            "bytes": spool.used,
            "capacity_bytes": spool.capacity,
            "oldest_ns": None if oldest is None else max(0, self._now() - oldest),
            "dead_letters": spool.dead_letters,
            "nodes": self._presence.online,
        }
