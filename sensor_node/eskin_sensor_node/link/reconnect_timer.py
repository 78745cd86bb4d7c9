"""When to reconnect because no gateway answers."""

from __future__ import annotations

from typing import Final

_LONGEST: Final = 16
"""Greatest factor of the patience: without a gateway, reconnects become rare."""


class ReconnectTimer:
    """Decides when to close a connection that carries no acknowledgements.

    A broker may take messages and lead them nowhere, or forget a subscription, and keep the
    connection alive all the while; a new connection is the only remedy a node has.

    Args:
        patience: Seconds without an answer until the first new connection; doubled with each
            further one.
    """

    def __init__(self, patience: float) -> None:
        self._first = self._patience = patience
        self._since: float | None = None

    def connected(self, now: float) -> None:
        """A connection stands; now: monotonic seconds."""
        self._since = now

    def answered(self, now: float) -> None:
        """A gateway has acknowledged something."""
        self._since = now
        self._patience = self._first

    def is_too_long(self, now: float, *, waiting: bool) -> bool:
        """Whether to reconnect; asked once for each connection.

        Args:
            now: Monotonic seconds.
            waiting: Whether messages wait for an answer; else silence means nothing.
        """
        if self._since is None:
            return False
        if not waiting:
            self._since = now
        if now < self._since + self._patience:
            return False
        self._since = None
        self._patience = min(2 * self._patience, _LONGEST * self._first)
        return True
