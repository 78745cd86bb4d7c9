"""The one runner of the cloud's background jobs."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from eskin.runtime.supervised import FaultLog

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from eskin_cloud.app_state import AppState


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
    faults = FaultLog()
    while not stopping.is_set():
        try:
            await work()
            faults.succeeded(name)
        except Exception as error:  # noqa: BLE001 - no error must stop the job
            if not faults.failed(name, error):
                cloud.metrics.faults.labels(name).inc()
        try:
            await asyncio.wait_for(stopping.wait(), every_s)
        except TimeoutError:
            continue
