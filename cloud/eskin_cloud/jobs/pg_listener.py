"""Listen to what other processes do on the same PostgreSQL server (LISTEN)."""

from __future__ import annotations

import logging
from functools import partial
from typing import TYPE_CHECKING, Final

import psycopg

from eskin.errors import StoreError
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.notify import CHANNEL, COMMANDS, FEED
from eskin_cloud.store.postgres import driver_arguments

if TYPE_CHECKING:
    import asyncio

    from sqlalchemy import URL

    from eskin_cloud.app_state import AppState

log = logging.getLogger(__name__)

_PAUSE_S: Final = 1.0
_POLL_S: Final = 1.0
"""A notification may be lost, so the feed is also read."""


async def listen(cloud: AppState, place: URL, stopping: asyncio.Event) -> None:
    """Listen until cancelled; reconnects to a server that was away."""
    work = partial(_listen, cloud, place)
    await run_periodically(
        "PostgreSQL listener", work, cloud=cloud, stopping=stopping, every_s=_PAUSE_S
    )


async def _listen(cloud: AppState, place: URL) -> None:
    """Listen until the connection ends.

    Raises:
        StoreError: The server cannot be reached.
    """
    words = driver_arguments(place)
    try:
        connection = await psycopg.AsyncConnection.connect(autocommit=True, **words)
    except psycopg.Error as error:
        raise StoreError(f"PostgreSQL cannot be reached: {error}") from error
    try:
        async with connection:
            await connection.execute(f"LISTEN {CHANNEL}".encode())
            cloud.notifier.wake()
            while True:
                # What was notified while this process did not listen, or was lost.
                try:
                    await cloud.feed.catch_up()
                except StoreError as error:  # a server of several does not answer
                    log.warning("feed not read: reason=%s", error)
                async for notice in connection.notifies(timeout=_POLL_S):
                    receive(cloud, notice.payload)
    except psycopg.Error as error:
        log.warning("PostgreSQL listener disconnected: reason=%s", error)


def receive(cloud: AppState, text: str) -> None:
    """Apply a notification of another process; this process's own are known."""
    kind, *words = text.split(" ")
    if kind == COMMANDS:
        cloud.notifier.wake()
    elif kind == FEED:
        writer, *cursors = words
        if writer != cloud.store.name:
            cloud.feed.advance(cloud.feed.last.advance(map(int, cursors)))
