"""What the cloud looks after by itself: silent nodes, renewed certificates, who looks on, locks."""

from __future__ import annotations

import asyncio
import logging
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from eskin.wire.timestamp import SECOND
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.notify import WATCHED, notify
from eskin_cloud.store.stuck_writer import end_stuck_writer
from eskin_cloud.store.write.ingest import IngestResult
from eskin_cloud.store.write.presence import give_up

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from eskin_cloud.app_state import AppState
    from eskin_cloud.jobs.server_certificate import Certificate

log = logging.getLogger(__name__)

_INTERVAL: Final = 1.0
_NAMES: Final = 100
"""Nodes in one notice, which holds less than 8000 bytes."""


async def watch(
    cloud: AppState, certificates: Sequence[Certificate], stopping: asyncio.Event
) -> None:
    """Look every second, until told to stop."""
    begun, due = cloud.clock(), time.monotonic()

    async def look() -> None:
        nonlocal due
        for certificate in certificates:
            if certificate.refresh():
                log.info("certificate renewed")
        await asyncio.to_thread(end_stuck_writer, cloud.store)
        silence = int(cloud.settings.nodes.silence_s * SECOND)
        # After a start, every node is first given the time to be heard.
        if cloud.clock() - begun >= silence:
            await _judge(cloud, silence)
        if time.monotonic() >= due:  # whatever the clock of the day does
            await _tell_viewers(cloud)
            due = time.monotonic() + cloud.settings.live.watched_s / 3

    await run_periodically("watch", look, cloud=cloud, stopping=stopping, every_s=_INTERVAL)


async def _tell_viewers(cloud: AppState) -> None:
    """Let other processes know which nodes are looked at here."""
    nodes = cloud.viewers.nodes[: cloud.settings.live.watched_nodes]
    if not nodes or isinstance(cloud.store.place, Path):
        return

    def work(connection: Connection) -> None:
        for begin in range(0, len(nodes), _NAMES):
            notify(connection, WATCHED, *nodes[begin : begin + _NAMES])

    await asyncio.wrap_future(cloud.store.write(work))


async def _judge(cloud: AppState, silence: int) -> None:
    def work(connection: Connection) -> IngestResult:
        now = cloud.clock()
        told = give_up(connection, cloud.store.cache, silent_since=now - silence, now=now)
        return IngestResult([], told, 0)

    written = cloud.store.write(work)
    cloud.feed.follow(written, asyncio.get_running_loop())
    await asyncio.wrap_future(written)
