"""For how long no gateway has answered, and when that is reason to connect anew."""

from __future__ import annotations

from typing import Final

_LONGEST: Final = 16
"""Times the first patience: with nobody at the other end, new connections grow rare."""


class ReconnectTimer:
    """Tells when a connection that stands but carries no answers should be given up.

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
        """Whether to connect anew; asked once for each connection.

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
