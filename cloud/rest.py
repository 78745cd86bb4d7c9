"""After a load is gone, what it took of the memory is given back."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Final

from cloud.chore import repeat
from eskin.errors import StoreError
from eskin.memory import MUCH, give_back

if TYPE_CHECKING:
    from cloud.state import Cloud

log = logging.getLogger(__name__)

_INTERVAL: Final = 5.0
_LITTLE: Final = 1_048_576
"""Bytes in an interval that are no load."""


async def rest(cloud: Cloud, stopping: asyncio.Event, *, interval: float = _INTERVAL) -> None:
    """Look every few seconds, until told to stop."""

    def worked() -> int:
        # Packing goes on for a while when nothing comes any more.
        return cloud.uploads.taken + cloud.store.packed

    seen = rested = worked()

    async def look() -> None:
        nonlocal seen, rested
        before, seen = seen, worked()
        if seen - before < _LITTLE and seen - rested >= MUCH:
            rested = seen
            await _shrink(cloud)

    await repeat("rest", look, cloud=cloud, stopping=stopping, every_s=interval)


async def _shrink(cloud: Cloud) -> None:
    try:
        await asyncio.to_thread(cloud.store.shrink)
    except StoreError as error:
        log.warning("store keeps its memory: reason=%s", error)
    await asyncio.to_thread(give_back)
