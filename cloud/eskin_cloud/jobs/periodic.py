"""The one runner of the cloud's background jobs."""

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
    """Run a job until `stopping` is set; an error ends neither it nor anything else.

    An error is logged once while it lasts. An unexpected one is counted, too.

    Args:
        name: The job's name in the log and in the metrics.
        work: Does the job once.
        cloud: Counts unexpected errors.
        stopping: Ends the job.
        every_s: Pause between two runs.
    """
    logged: type[Exception] | None = None
    while not stopping.is_set():
        try:
            await work()
            logged = None
        except (EskinError, OSError) as error:
            if logged is not type(error):
                log.warning("job failed, retrying: job=%s reason=%s", name, error)
            logged = type(error)
        except Exception as error:  # unexpected errors must not stop the job
            if logged is not type(error):
                log.exception("job failed unexpectedly, retrying: job=%s", name)
            logged = type(error)
            cloud.metrics.faults.labels(name).inc()
        try:
            await asyncio.wait_for(stopping.wait(), every_s)
        except TimeoutError:
            continue
