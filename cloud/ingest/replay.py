"""Tokens that were used, for as long as they are good."""

from __future__ import annotations

import hashlib
import heapq
import threading
from typing import TYPE_CHECKING, Protocol

from sqlalchemy import delete, insert, select

from cloud.store.schema import warrants
from eskin.moment import SECOND

if TYPE_CHECKING:
    from collections.abc import Callable

    from sqlalchemy import Connection

    from cloud.store import Store


class Memory(Protocol):
    """Remembers names until they expire."""

    def first(self, name: str, *, until: float, now: float) -> bool:
        """Whether a name comes for the first time; it is remembered.

        Args:
            name: Unique among tokens.
            until: When it expires, in seconds.
            now: The present, in seconds.
        """
        ...

    def within(self, name: str, *, until: float, now: float) -> Callable[[Connection], bool]:
        """The same question, to be asked in a transaction, with which the name is remembered.

        So a batch and its token need one commit, and no batch waits for those of others before it
        is read. Whoever keeps names in memory answers at once.
        """
        ...


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
        """Whether a name comes for the first time; see `Memory`."""
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

    def within(self, name: str, *, until: float, now: float) -> Callable[[Connection], bool]:
        """The answer of `first`, whatever becomes of the transaction; see `Memory`."""
        is_first = self.first(name, until=until, now=now)
        return lambda _: is_first


class SharedReplay:
    """The same for all processes on one store."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def first(self, name: str, *, until: float, now: float) -> bool:
        """Whether a name comes for the first time; see `Memory`.

        Raises:
            StoreError: It cannot be remembered.
        """
        return self._store.finish(self.within(name, until=until, now=now))

    def within(self, name: str, *, until: float, now: float) -> Callable[[Connection], bool]:
        """The question, to be asked in a transaction; see `Memory`."""
        digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()

        def work(connection: Connection) -> bool:
            here = warrants.c.digest == digest
            connection.execute(delete(warrants).where(warrants.c.until < int(now * SECOND)))
            if connection.execute(select(warrants.c.until).where(here)).first() is not None:
                return False
            connection.execute(insert(warrants).values(digest=digest, until=int(until * SECOND)))
            return True

        return work
