"""Compact old frames in the background, a little at a time."""

from __future__ import annotations

import asyncio
import time
from functools import partial
from typing import TYPE_CHECKING, Final

from eskin.wire.timestamp import SECOND
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_cloud.app_state import AppState

_MINUTE: Final = 60 * SECOND
_RESTS: Final = 3.0
"""It rests so many times as long as it worked: it takes a quarter of a processor at most."""


async def compact(cloud: AppState, stopping: asyncio.Event) -> None:
    """Compact what is old enough."""
    every_s = cloud.settings.compaction.every_s
    work = partial(_catch_up, cloud, stopping)
    await run_periodically("compaction", work, cloud=cloud, stopping=stopping, every_s=every_s)


async def _catch_up(cloud: AppState, stopping: asyncio.Event) -> None:
    settings, store = cloud.settings.compaction, cloud.store
    if not settings.on:
        return
    due = Due.after(cloud.clock(), int(settings.after_min * _MINUTE))
    own = await asyncio.to_thread(store.own_slots)
    for page in await asyncio.to_thread(find_compactable_frames, store, due, own):
        await _repeat(partial(compact_frames, store, page, due), stopping)


async def _repeat(work: Callable[[], bool], stopping: asyncio.Event) -> None:
    """Work step by step, as long as there is more."""
    more = True
    while more and not stopping.is_set():
        begun = time.monotonic()
        more = await asyncio.to_thread(work)
        await asyncio.sleep(_RESTS * (time.monotonic() - begun))
