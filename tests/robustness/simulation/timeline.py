"""Simulated time: events in order, and random draws by purpose."""

from __future__ import annotations

import heapq
import random
from itertools import count
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

SECOND: Final = 1_000_000_000
EPOCH: Final = 1_800_000_000 * SECOND
"""UTC ns at the beginning of a run."""


class KilledError(BaseException):
    """The part that runs was killed: nothing of it goes on.

    No `Exception`, because the product survives any of these.
    """


class Timeline:
    """Runs actions in the order of their times; equal times in the order of their scheduling.

    Args:
        seed: Of all draws.

    Attributes:
        now: ns since the beginning.
        steps: Actions that ran.
        history: What happened, a line each.
    """

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._due: list[tuple[int, int, Callable[[], None]]] = []
        self._numbers = count()
        self.now = 0
        self.steps = 0
        self.history: list[str] = []

    def draws(self, purpose: str) -> random.Random:
        """A generator for one purpose, so that a fault which is left out shifts no other draw."""
        return random.Random(f"{self._seed} {purpose}")  # noqa: S311 - a plan, no secret

    def monotonic(self) -> float:
        """Seconds."""
        return 1000.0 + self.now / SECOND

    def monotonic_ns(self) -> int:
        """ns."""
        return 1000 * SECOND + self.now

    def note(self, actor: str, event: str) -> None:
        """Add a line to the history."""
        self.history.append(f"{self.now / SECOND:.6f} {actor} {event}")

    def after(self, seconds: float, action: Callable[[], None]) -> None:
        """Schedule an action."""
        due = self.now + round(seconds * SECOND)
        heapq.heappush(self._due, (due, next(self._numbers), action))

    def elapse(self, seconds: float) -> None:
        """Run all that is due meanwhile. An action that waits may call this, too."""
        until = self.now + round(seconds * SECOND)
        while self._due and self._due[0][0] <= until:
            due, _, action = heapq.heappop(self._due)
            self.now = max(self.now, due)
            self.steps += 1
            action()
        self.now = max(self.now, until)
