"""Evaluate monitors over what arrives, and store the alarms that they raise."""

from __future__ import annotations

import asyncio
import math
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from eskin.wire.timestamp import SECOND
from eskin_cloud.alarms.receivers import forget_receivers, receiver_names
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.feed_entry import FEED_START
from eskin_cloud.store.write.alarms import (
    LEASE_NS,
    advance_alarms,
    apply_changes,
    find_due,
    take_lease,
)
from eskin_cloud.store.write.monitors import settle_monitors

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from eskin_cloud.app_state import AppState
    from eskin_cloud.store.feed_entry import FeedEntry, FeedPosition
    from eskin_cloud.store.write.alarms import AlarmChange

_PAUSE_S: Final = 0.05
_LONGEST_S: Final = 1.0
_ENTRIES: Final = 2000
_NOTE_S: Final = 60.0
"""How often it is noted how far monitors without a change have been evaluated."""


async def evaluate_monitors(cloud: AppState, stopping: asyncio.Event) -> None:
    """Evaluate monitors while this cloud has the lease to do so."""
    work = _Work(cloud)
    await run_periodically("monitors", work.step, cloud=cloud, stopping=stopping, every_s=_PAUSE_S)


class _Work:
    def __init__(self, cloud: AppState) -> None:
        self._cloud = cloud
        self._alone = isinstance(cloud.store.location, Path)
        self._position = cloud.feed.last
        # Up to here all was evaluated and stored, also late samples: an error leads back to it.
        self._stored: FeedPosition | None = None
        # Instants of the monotonic clock in s: the other one may jump.
        self._lease = self._timers = -math.inf
        self._noted = time.monotonic()

    async def step(self) -> None:
        """Evaluate what came, or wait for something.

        Raises:
            StoreError: The store cannot be used. After any error what was found is found again.
        """
        cloud, evaluator = self._cloud, self._cloud.evaluator
        try:
            if not await self._renew():
                self._position, self._stored = cloud.feed.last, None
                await asyncio.sleep(_LONGEST_S)
                return
            await asyncio.to_thread(evaluator.load)
            await self._advance_timers()
            if not evaluator.all_monitors:
                self._position = cloud.feed.last
                await asyncio.sleep(_LONGEST_S)
                return
            await cloud.feed.wait(self._position, _LONGEST_S)
            page = await cloud.feed.after(self._position, _ENTRIES)
            if page.compacted != FEED_START:  # what it is behind with is read as it is stored now
                evaluator.forget()
                self._position, self._stored = cloud.feed.last, None
                return
            await self._evaluate(page.entries, page.end)
            self._position = page.end
            if evaluator.examined:
                self._stored = page.end
        except Exception:
            evaluator.forget(stored=self._stored)
            if self._stored is not None:
                self._position = self._stored
            raise

    async def _evaluate(self, entries: Sequence[FeedEntry], position: FeedPosition) -> None:
        cloud, evaluator = self._cloud, self._cloud.evaluator
        ours = [each for each in entries if each.node in evaluator.nodes]
        await cloud.feed.layouts.load(ours)
        names = {each.layout for each in ours if each.layout is not None}
        layouts = {name: cloud.feed.layouts.get(name) for name in names}
        changes, settled = await asyncio.to_thread(
            partial(evaluator.evaluate, ours, layouts, position=position)
        )
        if time.monotonic() - self._noted >= _NOTE_S:
            self._noted, settled = time.monotonic(), evaluator.all_settled
        if changes or settled:
            await self._write(changes, settled)

    async def _write(self, changes: list[AlarmChange], settled: dict[tuple[str, int], int]) -> None:
        cloud, holder = self._cloud, self._cloud.evaluator.holder

        def work(connection: Connection) -> bool:
            held = apply_changes(connection, changes, holder=holder, now=cloud.clock())
            if held:
                settle_monitors(connection, settled)
            return held

        if not await asyncio.wrap_future(cloud.store.write(work)):
            self._lease, self._stored = -math.inf, None
            cloud.evaluator.forget()
        elif changes:
            self._news()

    async def _advance_timers(self) -> None:
        """Escalate alarms, and give those whose silence has ended."""
        cloud, holder, now = self._cloud, self._cloud.evaluator.holder, self._cloud.clock()
        if time.monotonic() - self._timers < _LONGEST_S:
            return
        self._timers = time.monotonic()

        def due() -> bool:
            with cloud.store.read() as connection:
                return bool(find_due(connection, now=now))

        if await asyncio.to_thread(due):
            work = partial(advance_alarms, holder=holder, now=now)
            await asyncio.wrap_future(cloud.store.write(work))
            self._news()

    async def _renew(self) -> bool:
        cloud, now = self._cloud, self._cloud.clock()
        if time.monotonic() < self._lease:
            return True
        holder, names = cloud.evaluator.holder, receiver_names(cloud.settings.alarms)

        def work(connection: Connection) -> bool:
            held = take_lease(connection, holder, now=now, alone=self._alone)
            if held and not cloud.evaluator.leads:
                forget_receivers(connection, names)
            return held

        held = await asyncio.wrap_future(cloud.store.write(work))
        cloud.evaluator.leads = held
        if not held:
            cloud.evaluator.forget()
            self._lease = -math.inf
            return False
        # Where no other cloud can be, the lease need not be renewed.
        self._lease = time.monotonic() + (3600.0 if self._alone else LEASE_NS / SECOND / 3)
        return True

    def _news(self) -> None:
        """Wake gateways and the delivery of alarms."""
        self._cloud.notifier.wake()
