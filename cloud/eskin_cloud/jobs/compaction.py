"""Compact old blocks in the background, a little at a time."""

from __future__ import annotations

import asyncio
import time
from functools import partial
from typing import TYPE_CHECKING, Final

from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.compaction import compact_page, find_compactable

if TYPE_CHECKING:
    from eskin_cloud.app_state import AppState

_RESTS: Final = 3.0
"""It rests so many times as long as it worked: it takes a quarter of a processor at most."""


async def compact(cloud: AppState, stopping: asyncio.Event) -> None:
    """Compact what is old enough."""
    every_s = cloud.settings.packing.every_s
    work = partial(_catch_up, cloud, stopping)
    await run_periodically("packing", work, cloud=cloud, stopping=stopping, every_s=every_s)


async def _catch_up(cloud: AppState, stopping: asyncio.Event) -> None:
    # What a live stream may be resumed from stays as it came; and as much again, for one at the
    # edge reads on while others store.
    store, behind = cloud.store, 2 * cloud.settings.live.backlog
    if not cloud.settings.packing.on:
        return
    for place in await asyncio.to_thread(find_compactable, store, behind):
        more = True
        while more and not stopping.is_set():
            begun = time.monotonic()
            more = await asyncio.to_thread(compact_page, store, place, behind)
            await asyncio.sleep(_RESTS * (time.monotonic() - begun))
