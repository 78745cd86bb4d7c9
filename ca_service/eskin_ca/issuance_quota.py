"""How many certificates one name may get: its holder could fill the CA's disk, and all memories."""

from __future__ import annotations

import time
from collections import deque
from contextlib import contextmanager
from typing import TYPE_CHECKING

from eskin.errors import IdentityError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


class IssuanceQuotaError(IdentityError):
    """A name got as many certificates as it may have for now."""


class IssuanceQuota:
    """So many in so many seconds, for each name; in memory.

    Args:
        most: How many.
        seconds: In which time.
        clock: Monotonic seconds.
    """

    def __init__(
        self, most: int, seconds: float, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._most = most
        self._seconds = seconds
        self._clock = clock
        self._taken: dict[str, deque[float]] = {}

    @contextmanager
    def take(self, name: str) -> Iterator[None]:
        """Count one that is issued in the block; not if that fails.

        Raises:
            TooOftenError: There were too many.
        """
        now = self._clock()
        taken = self._taken.setdefault(name, deque())
        while taken and taken[0] <= now - self._seconds:
            taken.popleft()
        if len(taken) >= self._most:
            raise IssuanceQuotaError(
                f"{name} got {self._most} certificates in {self._seconds:g} s; come again later"
            )
        yield
        taken.append(now)
