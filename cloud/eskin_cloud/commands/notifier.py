"""The board: wakes the gateways that wait for commands."""

from __future__ import annotations

import asyncio


class Notifier:
    """Counts what may concern a waiting gateway; on the event loop only.

    Attributes:
        version: Grows with every change.
        waiting: How many gateways wait.
        closed: Whether waiting has ended.
    """

    def __init__(self) -> None:
        self.version = 0
        self.waiting = 0
        self.closed = False
        self._news = asyncio.Event()

    def wake(self) -> None:
        """Say that a command was issued or answered."""
        self.version += 1
        self._news.set()
        self._news = asyncio.Event()

    def close(self) -> None:
        """Wake all waiters and close."""
        self.closed = True
        self.wake()

    async def wait(self, version: int, seconds: float) -> None:
        """Wait until something changed after a version, or the time is over."""
        news = self._news
        if self.version != version or self.closed:
            return
        self.waiting += 1
        try:
            await asyncio.wait_for(news.wait(), seconds)
        except TimeoutError:
            return
        finally:
            self.waiting -= 1
