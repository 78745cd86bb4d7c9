"""Hearing of what other processes do on the same PostgreSQL server: by LISTEN."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Final

import psycopg

from eskin.errors import EskinError
from eskin_cloud.store.notify import CHANNEL, COMMANDS, FEED, WATCHED
from eskin_cloud.store.postgres import arguments

if TYPE_CHECKING:
    from collections.abc import Callable

    from sqlalchemy import URL

    from eskin_cloud.app_state import AppState

log = logging.getLogger(__name__)

_PAUSE_S: Final = 1.0


async def relay(cloud: AppState, place: URL) -> None:
    """Listen until cancelled; comes back to a server that was away, which is told once."""
    told: type[Exception] | None = None

    def listening() -> None:
        nonlocal told
        told = None

    while True:
        try:
            await _listen(cloud, place, listening)
        except (psycopg.Error, EskinError, OSError) as error:
            if told is not type(error):
                log.warning("other processes are not heard: reason=%s", error)
            told = type(error)
        except Exception as error:  # others write what they like there; ingest and queries go on
            if told is not type(error):
                log.exception("other processes are not heard: broke, trying again")
            told = type(error)
            cloud.metrics.faults.labels("relay").inc()
        await asyncio.sleep(_PAUSE_S)


async def _listen(cloud: AppState, place: URL, listening: Callable[[], None]) -> None:
    words = arguments(place)
    async with await psycopg.AsyncConnection.connect(autocommit=True, **words) as connection:
        await connection.execute(f"LISTEN {CHANNEL}".encode())
        listening()
        # What was told while nobody listened.
        await cloud.feed.catch_up()
        cloud.notifier.wake()
        async for notice in connection.notifies():
            hear(cloud, notice.payload)


def hear(cloud: AppState, text: str) -> None:
    """Take in what was told; what we told ourselves is known."""
    kind, *words = text.split(" ")
    if kind == COMMANDS:
        cloud.notifier.wake()
    elif kind == FEED:
        cursor, writer = words
        if writer != cloud.store.cache.name:
            cloud.feed.advance(int(cursor))
    elif kind == WATCHED:
        cloud.viewers.hear(words)
