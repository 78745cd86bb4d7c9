"""How long to wait before trying again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from random import Random

MOST_PATIENCE_S: Final = 3600.0
"""Longest wait that a peer's Retry-After can ask for."""


class Backoff:
    """Exponential, with jitter, so that many do not come back at the same moment.

    Args:
        first: Seconds before the first retry.
        most: Most seconds.
        random: Source of jitter.
    """

    def __init__(self, first: float, most: float, *, random: Random) -> None:
        self._first = first
        self._most = most
        self._random = random
        self._failures = 0

    def failed(self, *, at_least: float | None = None) -> float:
        """Note a failure; gives the seconds to wait.

        Args:
            at_least: What the peer asked for.
        """
        # The exponent is bounded, or a long outage would overflow the float.
        limit = min(self._first * 2.0 ** min(self._failures, 30), self._most)
        self._failures += 1
        wait = limit * self._random.uniform(0.5, 1.0)
        return max(wait, min(at_least or 0.0, MOST_PATIENCE_S))

    def succeeded(self) -> None:
        """Start over."""
        self._failures = 0
