"""Note nodes as offline that were silent for too long."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING, Final

from eskin.wire.timestamp import SECOND
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.write.ingest import IngestResult
from eskin_cloud.store.write.presence import find_silent, mark_silent_offline

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin_cloud.app_state import AppState
    from eskin_cloud.store.write.write_cache import WriteCache

_INTERVAL_S: Final = 1.0


async def watch_silence(cloud: AppState, stopping: asyncio.Event) -> None:
    """Look for silent nodes each second."""
    begun = cloud.clock()
    silence = int(cloud.settings.nodes.silence_s * SECOND)

    def find() -> list[str]:
        now = cloud.clock()
        with cloud.store.read() as connection:
            return find_silent(connection, silent_since=now - silence, now=now)

    def mark(nodes: list[str], connection: Connection, cache: WriteCache) -> IngestResult:
        now = cloud.clock()
        events = mark_silent_offline(connection, cache, nodes, silent_since=now - silence, now=now)
        return IngestResult([], events, 0)

    async def look() -> None:
        # After a start, each node first has time to send.
        if cloud.clock() - begun >= silence:
            for each in cloud.store.shares(await asyncio.to_thread(find), str):
                written = cloud.store.write_slots(each.slots, partial(mark, each.items))
                cloud.feed.follow(written, asyncio.get_running_loop())
                await asyncio.wrap_future(written)

    await run_periodically("silence", look, cloud=cloud, stopping=stopping, every_s=_INTERVAL_S)
