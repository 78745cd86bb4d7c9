"""Remove what is too old or erased, in the background and in steps."""

from __future__ import annotations

import asyncio
import logging
from collections import defaultdict
from fnmatch import fnmatchcase
from functools import partial
from itertools import groupby
from operator import itemgetter
from typing import TYPE_CHECKING, Final, NamedTuple

from sqlalchemy import select

from eskin.privacy import is_biometric
from eskin.privacy.sealed_message import name_place
from eskin.wire.frames import Privacy
from eskin.wire.timestamp import SECOND
from eskin_cloud.jobs.clock_guard import ClockGuard
from eskin_cloud.jobs.erasure import pass_barrier, record_outcome
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.compaction import Due, PageKey, compact_frames
from eskin_cloud.store.descriptions import UnknownDescriptionError, find_layout
from eskin_cloud.store.removal import (
    PatchSweep,
    remove,
    remove_damaged_frames,
    remove_node_events,
    remove_rows,
    sweeps_of_erased,
    unfinished_erasures,
)
from eskin_cloud.store.schema.frame_tables import pages
from eskin_cloud.store.write.alarms import remove_cleared
from eskin_cloud.store.write.clock_state import load_clock, save_clock
from eskin_cloud.store.write.removal_counts import RemovalReason, Sweep

if TYPE_CHECKING:
    from collections.abc import Callable

    from sqlalchemy import Connection

    from eskin.privacy.sealed_message import Place
    from eskin_cloud.app_state import AppState
    from eskin_cloud.settings import RetentionSection
    from eskin_cloud.store.write.clock_state import ClockReading
    from eskin_cloud.store.write.write_cache import WriteCache

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
    erasures = await asyncio.to_thread(_unfinished, cloud)
    if erasures:
        await pass_barrier(cloud)
    for due in await asyncio.to_thread(_due, cloud, now):
        removed = most = cloud.settings.retention.at_once
        while removed >= most:
            removed = await _step(cloud, due)
            total += removed
            await asyncio.sleep(_PAUSE_S)
    if erasures:
        await record_outcome(cloud, erasures)
    for each in await asyncio.to_thread(_due_patches, cloud, now):
        total += await _sweep_patches(cloud, each)
    before = now - round(cloud.settings.alarms.days * 86_400 * SECOND)
    await asyncio.wrap_future(cloud.store.write(partial(remove_cleared, before=before)))
    return total


async def _sweep_patches(cloud: AppState, due: _DueNode) -> int:
    """Remove what is too old of a page's patches; its frames become rows of them first."""
    total, most, store = 0, cloud.settings.retention.at_once, cloud.store
    ended = Due(-(2**63), -(2**63), max(each.before for each in due.patches))
    for page in due.pages:
        more = True
        while more:
            more = await asyncio.to_thread(compact_frames, store, page, ended)
            await asyncio.sleep(_PAUSE_S)
        if due.before is not None:
            drop = partial(remove_damaged_frames, page=page, before=due.before)
            total += await asyncio.wrap_future(store.write_slots([page[0]], drop))
    for each in due.patches:
        removed = most
        while removed >= most:
            work = partial(_remove_rows, cloud, each)
            removed = await asyncio.wrap_future(store.write_node(each.node, work))
            total += removed
            if removed:
                _report(cloud, each.node, each.patch, RemovalReason.AGE, removed)
            await asyncio.sleep(_PAUSE_S)
    if due.before is not None:
        total += await _sweep_node_events(cloud, due.node, due.before)
    return total


async def _sweep_node_events(cloud: AppState, node: str, before: int) -> int:
    total, most = 0, cloud.settings.retention.at_once

    def work(connection: Connection, _: WriteCache) -> int:
        return remove_node_events(connection, node, before, most=most)

    removed = most
    while removed >= most:
        removed = await asyncio.wrap_future(cloud.store.write_node(node, work))
        total += removed
        if removed:
            _report(cloud, node, "events", RemovalReason.AGE, removed)
        await asyncio.sleep(_PAUSE_S)
    return total


def _remove_rows(
    cloud: AppState, due: PatchSweep, connection: Connection, cache: WriteCache
) -> int:
    del cache
    most = cloud.settings.retention.at_once
    return remove_rows(connection, due, most=most, now=cloud.clock())


def kept_for(rules: RetentionSection, node: str, channel: str) -> float:
    """Days that a channel is kept; 0: forever."""
    for place, days in rules.channels.items():
        if fnmatchcase(f"{node}/{channel}", place):
            return days
    if is_biometric(channel) and rules.biometric_days > 0:
        return rules.biometric_days
    return rules.days


async def _step(cloud: AppState, due: Sweep) -> int:
    most = cloud.settings.retention.at_once

    def work(connection: Connection, cache: WriteCache) -> int:
        return remove(connection, cache, due, most=most, now=cloud.clock())

    removed = await asyncio.wrap_future(cloud.store.write_node(due.node, work))
    if removed:
        _report(cloud, due.node, due.place, due.reason, removed)
    return removed


def _report(cloud: AppState, node: str, place: str, reason: RemovalReason, removed: int) -> None:
    cloud.metrics.removed.labels(reason.value).inc(removed)
    log.info("removed: node=%s place=%s reason=%s messages=%d", node, place, reason, removed)


def _unfinished(cloud: AppState) -> list[tuple[str, str]]:
    with cloud.store.read() as connection:
        return unfinished_erasures(connection)


def _due(cloud: AppState, now: int) -> list[Sweep]:
    with cloud.store.read() as connection:
        sealed = _due_sealed(connection, cloud.settings.retention, now)
        return sweeps_of_erased(connection) + sealed


def _due_sealed(connection: Connection, rules: RetentionSection, now: int) -> list[Sweep]:
    """What is too old of sealed frames and statements, which are kept as long as any channel."""
    found: dict[tuple[str, str], Sweep] = {}
    query = select(pages.c.node, pages.c.layout).distinct()
    for node, layout in connection.execute(query.order_by(pages.c.node, pages.c.layout)).all():
        try:
            described = find_layout(connection, node, layout)
        except UnknownDescriptionError:
            continue  # damaged, and reported
        days: dict[Place, list[float]] = defaultdict(list)
        for page in described.biometric_pages:
            for number in described.page_ranges[page]:
                kept = [kept_for(rules, node, each) for each in described.patches[number].channels]
                days[described.hash, page] += kept
                days[described.hash] += kept
        for place, kept in days.items():
            if min(kept) > 0:
                name, before = name_place(place), now - int(max(kept) * _DAY)
                found[node, name] = Sweep(node, name, RemovalReason.AGE, before)
    return list(found.values())


class _DueNode(NamedTuple):
    """What is removed of a node.

    Attributes:
        node: The node.
        pages: Pages whose frames may be too old.
        before: Damaged frames, and events of the node as a whole, that ended before it are
            removed, UTC ns; ``None`` if a patch is kept forever.
        patches: What is removed of each patch.
    """

    node: str
    pages: list[PageKey]
    before: int | None
    patches: list[PatchSweep]


def _due_patches(cloud: AppState, now: int) -> list[_DueNode]:
    """What is too old of each node's patches. A patch is kept as long as any of its channels."""
    p, rules, found = pages.c, cloud.settings.retention, []
    with cloud.store.read() as connection:
        query = select(p.slot, p.node, p.layout, p.page, p.t_first)
        rows = connection.execute(query.order_by(p.node, p.layout, p.page)).all()
        for node, of_node in groupby(rows, itemgetter(1)):
            mine = list(of_node)
            channels_of: dict[str, dict[str, None]] = defaultdict(dict)
            for layout in dict.fromkeys(row[2] for row in mine):
                try:
                    described = find_layout(connection, node, layout)
                except UnknownDescriptionError:
                    continue  # damaged, and reported
                for patch in described.patches:
                    if patch.privacy is Privacy.BIOMETRIC:
                        continue  # sealed
                    channels_of[patch.patch_id] |= dict.fromkeys(patch.channels)
            kept = {
                patch: [kept_for(rules, node, channel) for channel in names]
                for patch, names in channels_of.items()
            }
            sweeps = [
                PatchSweep(node, patch, tuple(channels_of[patch]), now - int(max(days) * _DAY))
                for patch, days in kept.items()
                if min(days) > 0
            ]
            if not sweeps:
                continue
            last = max(each.before for each in sweeps)
            old = [(r[0], r[1], r[2], r[3]) for r in mine if r[4] is not None and r[4] < last]
            all_limited = len(sweeps) == len(kept)
            before = min(each.before for each in sweeps) if all_limited else None
            found.append(_DueNode(node, old, before, sweeps))
    return found
