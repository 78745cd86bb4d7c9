"""Which nodes somebody looks at, as the cloud says with each batch that it takes."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from eskin.wire.messages.acknowledgement import MOST_WATCHED

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_MS: Final = 1000
_MOST: Final = 4096
"""Nodes, lest a cloud that lies fills our memory."""


class Viewers:
    """Remembers for how long nodes are watched; one thread notes, another one asks.

    Args:
        clock: Monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._until: dict[str, float] = {}

    def note(self, watched: Mapping[str, float]) -> None:
        """Take what the cloud says: nodes, and seconds for which each is watched."""
        if not watched and not self._until:
            return
        now = self._clock()
        standing = {node: until for node, until in self._until.items() if until > now}
        standing |= {node: now + seconds for node, seconds in watched.items()}
        self._until = dict(list(standing.items())[-_MOST:])

    def remaining(self, node: str) -> int:
        """Ms for which a node is watched; 0: it is not."""
        until = self._until.get(node)
        if until is None:
            return 0
        return max(0, min(MOST_WATCHED, round((until - self._clock()) * _MS)))
