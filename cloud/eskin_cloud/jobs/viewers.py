"""Notify other clouds on the same PostgreSQL server which nodes are viewed here."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Final

from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.notify import WATCHED, notify

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin_cloud.app_state import AppState

_NAMES: Final = 100
"""Nodes in one notification, which holds less than 8000 bytes."""


async def announce_viewed_nodes(cloud: AppState, stopping: asyncio.Event) -> None:
    """Notify three times in the time that a view counts."""
    if isinstance(cloud.store.location, Path):
        return

    async def announce() -> None:
        nodes = cloud.viewers.nodes[: cloud.settings.live.watched_nodes]

        def write(connection: Connection) -> None:
            for begin in range(0, len(nodes), _NAMES):
                notify(connection, WATCHED, *nodes[begin : begin + _NAMES])

        if nodes:
            await asyncio.wrap_future(cloud.store.write(write))

    every_s = cloud.settings.live.watched_s / 3
    await run_periodically("viewers", announce, cloud=cloud, stopping=stopping, every_s=every_s)
