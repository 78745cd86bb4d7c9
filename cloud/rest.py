"""After a load is gone, what it took of the memory is given back."""

from __future__ import annotations

import asyncio
import logging
from functools import partial
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
    work = partial(_give_back, cloud, _Work(cloud))
    await repeat("rest", work, cloud=cloud, stopping=stopping, every_s=interval)


class _Work:
    """What took memory since it was last given back."""

    def __init__(self, cloud: Cloud) -> None:
        self._cloud = cloud
        self._came = cloud.uploads.taken
        self._worked = self._rested = self._total()

    def leaves_much(self) -> bool:
        """Whether the load is gone, and it is worth while to give back what it took."""
        came, worked = self._came, self._worked
        self._came, self._worked = self._cloud.uploads.taken, self._total()
        if self._came - came >= _LITTLE:
            return False
        # Packing goes on for long after a load: memory is given back meanwhile, and in the end.
        much = _LITTLE if self._worked == worked else MUCH
        if self._worked - self._rested < much:
            return False
        self._rested = self._worked
        return True

    def _total(self) -> int:
        return self._cloud.uploads.taken + self._cloud.store.packed


async def _give_back(cloud: Cloud, work: _Work) -> None:
    if work.leaves_much():
        await _shrink(cloud)


async def _shrink(cloud: Cloud) -> None:
    try:
        await asyncio.to_thread(cloud.store.shrink)
    except StoreError as error:
        log.warning("store keeps its memory: reason=%s", error)
    await asyncio.to_thread(give_back)
