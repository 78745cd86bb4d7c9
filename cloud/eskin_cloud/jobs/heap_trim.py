"""Return memory to the system: now and then under a load, and all of it afterwards."""

from __future__ import annotations

import asyncio
import logging
import time
from typing import TYPE_CHECKING, Final

import pyarrow as pa

from eskin.errors import StoreError
from eskin.runtime.memory import MUCH, HeapTrimmer, give_back, keep_large_apart
from eskin_cloud.jobs.periodic import run_periodically

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_cloud.app_state import AppState

log = logging.getLogger(__name__)

_INTERVAL: Final = 5.0
_LITTLE: Final = 1_048_576
"""Bytes in an interval that are no load."""


def use_one_allocator() -> None:
    """Allocate by the C library alone, large pieces apart.

    Arrow would use mimalloc, which keeps pages for each thread that ever used it; nothing that is
    given back now and then comes from there (`eskin.runtime.memory.give_back`).
    """
    keep_large_apart()
    pa.set_memory_pool(pa.system_memory_pool())


async def trim_heap(
    cloud: AppState,
    stopping: asyncio.Event,
    *,
    interval: float = _INTERVAL,
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Look every few seconds."""
    # Compaction goes on for long when nothing comes any more, and a little of it fills all caches.
    load = _Work(lambda: cloud.uploads.taken, most=_LITTLE)
    compaction = _Work(lambda: cloud.store.compacted, most=0)
    heap_trimmer = HeapTrimmer(clock)

    async def look() -> None:
        over = [work.is_over() for work in (load, compaction)]  # both look
        if any(over):
            await _shrink(cloud)
        else:
            await asyncio.to_thread(heap_trimmer.take, load.came + compaction.came)

    await run_periodically("memory", look, cloud=cloud, stopping=stopping, every_s=interval)


class _Work:
    """Work that takes memory.

    Args:
        count: How many bytes it took in since the start.
        most: So many in an interval are none.

    Attributes:
        came: How many bytes it took in between the last two looks.
    """

    def __init__(self, count: Callable[[], int], most: int) -> None:
        self._count = count
        self._most = most
        self._seen = self._rested = count()
        self.came = 0

    def is_over(self) -> bool:
        """Whether there was much of it, and in the last interval none; true once."""
        before, self._seen = self._seen, self._count()
        self.came = self._seen - before
        if self.came > self._most or self._seen - self._rested < MUCH:
            return False
        self._rested = self._seen
        return True


async def _shrink(cloud: AppState) -> None:
    try:
        await asyncio.to_thread(cloud.store.shrink)
    except StoreError as error:
        log.warning("store keeps its memory: reason=%s", error)
    await asyncio.to_thread(give_back)
