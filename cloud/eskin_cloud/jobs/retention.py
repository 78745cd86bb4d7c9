"""Remove what is too old or erased, in the background and in steps."""

from __future__ import annotations

import asyncio
import logging
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Final

from sqlalchemy import select

from eskin.privacy import is_biometric
from eskin.wire.timestamp import SECOND
from eskin_cloud.jobs.clock_guard import ClockGuard
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.removal import RemovalReason, Sweep, remove, sweeps_of_erased
from eskin_cloud.store.schema.tables import channels
from eskin_cloud.store.write.clock_state import load_clock, save_clock

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_cloud.app_state import AppState
    from eskin_cloud.settings import RetentionSection
    from eskin_cloud.store.write.clock_state import ClockReading

log = logging.getLogger(__name__)

_DAY: Final = 86_400 * SECOND
_PAUSE_S: Final = 0.01


async def apply_retention(cloud: AppState, stopping: asyncio.Event) -> None:
    """Look for what is too old, or erased."""
    every_s = cloud.settings.retention.every_s
    await run_periodically(
        "retention", Rounds(cloud), cloud=cloud, stopping=stopping, every_s=every_s
    )


class Rounds:
    """One sweep after another, by a time that no leap of the clock reaches, nor a start.

    Args:
        cloud: The cloud.
    """

    def __init__(self, cloud: AppState) -> None:
        self._cloud = cloud
        self._steady: ClockGuard | None = None

    async def __call__(self) -> None:
        """Remove what is too old, and keep what time it was.

        Raises:
            StoreError: The store cannot be read or written.
        """
        if self._steady is None:
            last = await asyncio.to_thread(_last, self._cloud)
            self._steady = ClockGuard(self._cloud.clock, last=last)
        await sweep(self._cloud, clock=self._steady)
        reading = self._steady.read()
        written = self._cloud.store.write(lambda connection: save_clock(connection, reading))
        await asyncio.wrap_future(written)


def _last(cloud: AppState) -> ClockReading | None:
    with cloud.store.read() as connection:
        return load_clock(connection)


async def sweep(cloud: AppState, *, clock: Callable[[], int] | None = None) -> int:
    """Remove all that is too old or erased now; gives how many messages.

    Each step is a write of its own among those of ingest, none longer than theirs.

    Args:
        cloud: The cloud.
        clock: UTC ns, by which it is too old; the cloud's own by default.

    Raises:
        StoreError: The store cannot be read or written.
    """
    total = 0
    now = (clock or cloud.clock)()
    for due in await asyncio.to_thread(_due, cloud, now):
        removed = most = cloud.settings.retention.at_once
        while removed >= most:
            removed = await _step(cloud, due)
            total += removed
            await asyncio.sleep(_PAUSE_S)
    return total


def kept_for(rules: RetentionSection, node: str, channel: str) -> float:
    """Days that a channel is kept; 0: for ever."""
    for place, days in rules.channels.items():
        if fnmatchcase(f"{node}/{channel}", place):
            return days
    if is_biometric(channel) and rules.biometric_days > 0:
        return rules.biometric_days
    return rules.days


async def _step(cloud: AppState, due: Sweep) -> int:
    most, store = cloud.settings.retention.at_once, cloud.store
    written = store.write(lambda c: remove(c, store.cache, due, most=most, now=cloud.clock()))
    removed = await asyncio.wrap_future(written)
    if removed:
        cloud.metrics.removed.labels(due.reason.value).inc(removed)
        log.info(
            "removed: node=%s channel=%s reason=%s messages=%d",
            due.node,
            due.channel,
            due.reason,
            removed,
        )
    return removed


def _due(cloud: AppState, now: int) -> list[Sweep]:
    rules = cloud.settings.retention
    with cloud.store.read() as connection:
        found = sweeps_of_erased(connection)
        for node, channel in connection.execute(select(channels.c.node, channels.c.channel)):
            days = kept_for(rules, node, channel)
            if days > 0:
                found.append(Sweep(node, channel, RemovalReason.AGE, now - int(days * _DAY)))
    return found
