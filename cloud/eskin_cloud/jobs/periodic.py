"""Work that the cloud does again and again in the background, whatever becomes of it."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING

from eskin.errors import EskinError

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from eskin_cloud.app_state import AppState

log = logging.getLogger(__name__)


async def run_periodically(
    name: str,
    work: Callable[[], Awaitable[object]],
    *,
    cloud: AppState,
    stopping: asyncio.Event,
    every_s: float,
) -> None:
    """Do some work until told to stop. What breaks it ends nothing else, and is tried again.

    It is told once while it lasts; what nobody foresaw is counted, too.

    Args:
        name: What it is.
        work: Does it once.
        cloud: Counts what broke.
        stopping: Tells to stop.
        every_s: Rest between two times.
    """
    told: type[Exception] | None = None
    while not stopping.is_set():
        try:
            await work()
            told = None
        except (EskinError, OSError) as error:
            if told is not type(error):
                log.warning("%s: trying again: reason=%s", name, error)
            told = type(error)
        except Exception as error:  # ingest and queries go on without it
            if told is not type(error):
                log.exception("%s: broke, trying again", name)
            told = type(error)
            cloud.metrics.faults.labels(name).inc()
        try:
            await asyncio.wait_for(stopping.wait(), every_s)
        except TimeoutError:
            continue
