"""Packing what lies in the store for long, in the background: a little at a time, behind ingest."""

from __future__ import annotations

import asyncio
import logging
import time
from typing import TYPE_CHECKING, Final

from cloud.store.packing import find_packable, pack_some
from eskin.errors import StoreError

if TYPE_CHECKING:
    from cloud.state import Cloud

log = logging.getLogger(__name__)

_RESTS: Final = 3.0
"""It rests so many times as long as it worked: it takes a quarter of a processor at most."""


async def keep_packed(cloud: Cloud, stopping: asyncio.Event) -> None:
    """Pack what is old enough, until told to stop."""
    while not stopping.is_set():
        try:
            await _catch_up(cloud, stopping)
        except StoreError as error:
            log.warning("nothing packed, trying again: reason=%s", error)
        try:
            await asyncio.wait_for(stopping.wait(), cloud.settings.packing.every_s)
        except TimeoutError:
            continue


async def _catch_up(cloud: Cloud, stopping: asyncio.Event) -> None:
    # What a live stream may be resumed from stays as it came.
    store, behind = cloud.store, cloud.settings.live.backlog
    if not cloud.settings.packing.on:
        return
    for place in await asyncio.to_thread(find_packable, store, behind):
        more = True
        while more and not stopping.is_set():
            begun = time.monotonic()
            more = await asyncio.to_thread(pack_some, store, place, behind)
            await asyncio.sleep(_RESTS * (time.monotonic() - begun))
