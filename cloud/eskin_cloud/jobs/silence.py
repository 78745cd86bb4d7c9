"""Note nodes as offline that were silent for too long."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final

from eskin.wire.timestamp import SECOND
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.write.ingest import IngestResult
from eskin_cloud.store.write.presence import mark_silent_offline

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin_cloud.app_state import AppState

_INTERVAL_S: Final = 1.0


async def watch_silence(cloud: AppState, stopping: asyncio.Event) -> None:
    """Look for silent nodes each second."""
    begun = cloud.clock()
    silence = int(cloud.settings.nodes.silence_s * SECOND)

    def mark(connection: Connection) -> IngestResult:
        now = cloud.clock()
        events = mark_silent_offline(
            connection, cloud.store.cache, silent_since=now - silence, now=now
        )
        return IngestResult([], events, 0)

    async def look() -> None:
        # After a start, each node first has time to send.
        if cloud.clock() - begun >= silence:
            written = cloud.store.write(mark)
            cloud.feed.follow(written, asyncio.get_running_loop())
            await asyncio.wrap_future(written)

    await run_periodically("silence", look, cloud=cloud, stopping=stopping, every_s=_INTERVAL_S)
