"""Looking for messages that were made and never came."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final

from sqlalchemy import exists, select

from cloud.chore import repeat
from cloud.store.holes import Boot, Span, find_holes, holes, keep_holes
from cloud.store.intake import Outcome
from eskin.moment import SECOND

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from cloud.state import Cloud

_LOOKS: Final = 10
"""In the time after which a hole is named."""
_LONGEST_S: Final = 60.0


async def look_for_missing(cloud: Cloud, stopping: asyncio.Event) -> None:
    """Look again and again, until told to stop."""
    every_s = min(_LONGEST_S, cloud.settings.nodes.missing_s / _LOOKS)
    await repeat(
        "missing", lambda: look(cloud), cloud=cloud, stopping=stopping, every_s=max(0.1, every_s)
    )


async def look(cloud: Cloud) -> None:
    """Look once.

    Raises:
        StoreError: The store cannot be read or written.
    """
    found, known = await asyncio.to_thread(_find, cloud)
    if not found and not known:
        return
    patience = round(cloud.settings.nodes.missing_s * SECOND)

    def work(connection: Connection) -> Outcome:
        now, cache = cloud.clock(), cloud.store.cache
        return Outcome([], keep_holes(connection, cache, found, patience=patience, now=now), 0)

    written = cloud.store.write(work)
    cloud.feed.follow(written, asyncio.get_running_loop())
    await asyncio.wrap_future(written)


def _find(cloud: Cloud) -> tuple[dict[Boot, list[Span]], bool]:
    with cloud.store.read() as connection:
        known = connection.execute(select(exists(select(holes.c.node)))).scalar_one()
        return find_holes(connection), bool(known)
