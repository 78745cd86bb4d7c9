"""The thread that fetches commands: it connects out and waits; nobody connects in."""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress
from threading import Thread
from typing import TYPE_CHECKING, Final

from eskin.errors import CloudError

if TYPE_CHECKING:
    from eskin_gateway.backoff import Backoff
    from eskin_gateway.commands.pending import PendingCommands
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.upstream.commands_client import Deliveries

log = logging.getLogger(__name__)

_LOOK_S: Final = 0.05
_MOST_LOOKS: Final = 20


class CommandPoller:
    """Asks the cloud again and again, each time until something changes.

    Args:
        commands: Takes what the cloud gives.
        commands_client: The cloud.
        wait_s: Seconds that the cloud may let it wait.
        backoff: Between failures.
        metrics: What is counted.
    """

    def __init__(
        self,
        commands: PendingCommands,
        *,
        commands_client: Deliveries,
        wait_s: float,
        backoff: Backoff,
        metrics: Metrics,
    ) -> None:
        self._commands = commands
        self._commands_client = commands_client
        self._wait = wait_s
        self._backoff = backoff
        self._metrics = metrics
        self.fault: str | None = None
        self._running: tuple[asyncio.AbstractEventLoop, asyncio.Task[None], Thread] | None = None

    def start(self) -> None:
        """Work in a thread."""
        loop = asyncio.new_event_loop()
        task = loop.create_task(self._serve())
        thread = Thread(target=self._run, args=(loop, task), name="courier", daemon=True)
        self._running = loop, task, thread
        thread.start()

    def stop(self) -> None:
        """Hang up at once, and end the thread."""
        if self._running is not None:
            loop, task, thread = self._running
            loop.call_soon_threadsafe(task.cancel)
            thread.join()
            loop.close()

    def _run(self, loop: asyncio.AbstractEventLoop, task: asyncio.Task[None]) -> None:
        with suppress(asyncio.CancelledError):
            loop.run_until_complete(task)
        loop.run_until_complete(self._commands_client.close())

    async def _serve(self) -> None:
        while True:
            try:
                await self.fetch()
            except CloudError as error:
                self._metrics.cloud_failures.inc()
                if self.fault is None:
                    log.warning("commands cannot be fetched: %s", error)
                self.fault = str(error)
                await asyncio.sleep(self._backoff.failed(at_least=error.retry_after))
            except Exception:  # the thread's outermost loop: what broke is told and counted
                log.exception("fetching commands failed unexpectedly; trying again")
                self._metrics.cloud_failures.inc()
                await asyncio.sleep(self._backoff.failed())

    async def fetch(self) -> None:
        """Ask once.

        Raises:
            CloudError: The cloud did not answer as agreed.
        """
        # After a failure it is first of all good to know that the cloud answers again.
        wait = 0.0 if self.fault is not None else self._wait
        changes = await self._commands_client.fetch(self._commands.held(), wait)
        self._backoff.succeeded()
        self.fault = None
        self._commands.change(changes.give, changes.drop)
        if changes.give:
            log.info("commands fetched: nodes=%d", len(changes.give))
        # So that the next question can tell of what was published; and never without a pause.
        for _ in range(_MOST_LOOKS):
            await asyncio.sleep(_LOOK_S)
            if all(sent for _, _, sent in self._commands.held()):
                break
