"""Changes to the CA on behalf of visitors: in a thread, while the event loop goes on."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final, TypeVar

from eskin.errors import LockedError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

T = TypeVar("T")

MOST: Final = 64
PATIENCE_S: Final = 10.0
"""Then queued callers get 503 with Retry-After: clients wait no longer for an answer."""


class ChangeQueue:
    """Serves one at a time, as only one may change the CA, and lets so many stand in the queue.

    Args:
        directory: The CA's folder.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._free = asyncio.Semaphore(1)
        self._inside = 0

    async def do(self, change: Callable[[], T]) -> T:
        """Have a change made, and give what it gives.

        Raises:
            LockedError: Too many wait, or another writer held the CA's lock for too long.
        """
        if self._inside >= MOST:
            raise LockedError(self._directory)
        self._inside += 1
        try:
            await self._wait()
            try:
                return await asyncio.to_thread(change)
            finally:
                self._free.release()
        finally:
            self._inside -= 1

    async def _wait(self) -> None:
        try:
            async with asyncio.timeout(PATIENCE_S):
                await self._free.acquire()
        except TimeoutError as error:
            raise LockedError(self._directory) from error
