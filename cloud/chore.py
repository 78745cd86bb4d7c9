"""Work that the cloud does again and again in the background, whatever becomes of it."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING

from eskin.errors import StoreError

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from cloud.state import Cloud

log = logging.getLogger(__name__)


async def repeat(
    name: str,
    work: Callable[[], Awaitable[object]],
    *,
    cloud: Cloud,
    stopping: asyncio.Event,
    every_s: float,
) -> None:
    """Do some work until told to stop. What breaks it is told and counted, and ends nothing else.

    Args:
        name: What it is.
        work: Does it once.
        cloud: Counts what broke.
        stopping: Tells to stop.
        every_s: Rest between two times.
    """
    while not stopping.is_set():
        try:
            await work()
        except StoreError as error:
            log.warning("%s: trying again: reason=%s", name, error)
        except Exception:  # ingest and queries go on without it
            log.exception("%s: broke, trying again", name)
            cloud.metrics.faults.labels(name).inc()
        try:
            await asyncio.wait_for(stopping.wait(), every_s)
        except TimeoutError:
            continue
