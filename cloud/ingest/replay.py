"""Tokens that were used, for as long as they are good."""

from __future__ import annotations

import heapq
import threading


class Replay:
    """Remembers names until they expire; at most ``capacity`` of them.

    When full, the name that expires first is forgotten: a batch that comes twice is stored once
    anyway, so forgetting costs no truth.
    """

    def __init__(self, capacity: int = 100_000) -> None:
        self._capacity = capacity
        self._expiries: list[tuple[float, str]] = []
        self._names: set[str] = set()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._names)

    def first(self, name: str, *, until: float, now: float) -> bool:
        """Whether a name comes for the first time; it is remembered.

        Args:
            name: Unique among tokens.
            until: When it expires, in seconds.
            now: The present, in seconds.
        """
        with self._lock:
            while self._expiries and (
                self._expiries[0][0] < now or len(self._expiries) >= self._capacity
            ):
                self._names.discard(heapq.heappop(self._expiries)[1])
            if name in self._names:
                return False
            heapq.heappush(self._expiries, (until, name))
            self._names.add(name)
            return True
