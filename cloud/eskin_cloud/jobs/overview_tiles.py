"""Keep the pyramid up to date in the background, a little at a time."""

from __future__ import annotations

import asyncio
import time
from functools import partial
from typing import TYPE_CHECKING, Final

from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.rollup.patch_tile_builder import claim, find_stale, find_unclaimed, rebuild

if TYPE_CHECKING:
    from eskin_cloud.app_state import AppState

_EVERY_S: Final = 2.0
_RESTS: Final = 3.0
"""While others write, it rests so many times as long as it worked: it takes a quarter at most."""


async def build_rollup(cloud: AppState, stopping: asyncio.Event) -> None:
    """Build what is new or changed."""
    work = partial(_catch_up, cloud, stopping)
    await run_periodically("pyramid", work, cloud=cloud, stopping=stopping, every_s=_EVERY_S)


async def _catch_up(cloud: AppState, stopping: asyncio.Event) -> None:
    store = cloud.store
    own = await asyncio.to_thread(store.own_slots)
    for place in await asyncio.to_thread(find_unclaimed, store, own):
        while not stopping.is_set() and await asyncio.to_thread(claim, store, place):
            pass
    stale = await asyncio.to_thread(find_stale, store, None, own)
    while stale is not None and not stopping.is_set():
        more = True
        while more and not stopping.is_set():
            begun = time.monotonic()
            more = await asyncio.to_thread(rebuild, store, stale)
            await _rest(cloud, begun)
        stale = await asyncio.to_thread(find_stale, store, stale, own)


async def _rest(cloud: AppState, begun: float) -> None:
    if cloud.store.waiting:
        await asyncio.sleep(_RESTS * (time.monotonic() - begun))
