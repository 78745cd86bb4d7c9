"""Look for messages that were made and never arrived."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING, Final

from sqlalchemy import select

from eskin.wire.timestamp import SECOND
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.schema.tables import missing_ranges
from eskin_cloud.store.write.ingest import IngestResult
from eskin_cloud.store.write.missing_messages import Boot, Span, find_missing, update_missing

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin_cloud.app_state import AppState
    from eskin_cloud.store.write.write_cache import WriteCache

_LOOKS: Final = 10
"""In the time after which a hole is named."""
_LONGEST_S: Final = 60.0


async def find_missing_messages(cloud: AppState, stopping: asyncio.Event) -> None:
    """Look at intervals."""
    every_s = min(_LONGEST_S, cloud.settings.nodes.missing_s / _LOOKS)
    await run_periodically(
        "missing", lambda: look(cloud), cloud=cloud, stopping=stopping, every_s=max(0.1, every_s)
    )


async def look(cloud: AppState) -> None:
    """Look once.

    Raises:
        StoreError: The store cannot be read or written.
    """
    found, known = await asyncio.to_thread(_find, cloud)
    if not found and not known:
        return
    patience = round(cloud.settings.nodes.missing_s * SECOND)

    def work(nodes: list[str], connection: Connection, cache: WriteCache) -> IngestResult:
        now = cloud.clock()
        ours = {boot: spans for boot, spans in found.items() if boot[0] in nodes}
        entries = update_missing(connection, cache, nodes, ours, patience=patience, now=now)
        return IngestResult([], entries, 0)

    for each in cloud.store.shares(sorted({node for node, _ in found} | known), str):
        written = cloud.store.write_slots(each.slots, partial(work, each.items))
        cloud.feed.follow(written, asyncio.get_running_loop())
        await asyncio.wrap_future(written)


def _find(cloud: AppState) -> tuple[dict[Boot, list[Span]], set[str]]:
    with cloud.store.read() as connection:
        known = connection.execute(select(missing_ranges.c.node).distinct()).scalars()
        return find_missing(connection), set(known)
