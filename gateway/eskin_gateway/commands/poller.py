"""The thread that fetches commands from the cloud by long polling."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from eskin.runtime.supervised import Supervised

if TYPE_CHECKING:
    from eskin.runtime.supervised import Backoff
    from eskin_gateway.commands.pending import PendingCommands
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.upstream.commands_client import CommandsClient

log = logging.getLogger(__name__)

_TICK_S: Final = 0.05
_MAX_TICKS: Final = 20


class CommandPoller:
    """Polls the cloud; each request ends when something changes.

    Args:
        commands: Updated with the changes.
        commands_client: Asks the cloud.
        wait_s: Most seconds of a request.
        backoff: Delays after failures.
        metrics: Counts failures.
    """

    def __init__(
        self,
        commands: PendingCommands,
        *,
        commands_client: CommandsClient,
        wait_s: float,
        backoff: Backoff,
        metrics: Metrics,
    ) -> None:
        self._commands = commands
        self._commands_client = commands_client
        self._wait_s = wait_s
        self._thread = Supervised(
            "command_poller",
            self._poll,
            backoff=backoff,
            on_failure=lambda _: metrics.cloud_failures.inc(),
        )

    @property
    def fault(self) -> str | None:
        """Why no commands can be fetched."""
        return self._thread.fault

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the open request and the thread."""
        self._thread.stopping.set()
        self._commands_client.abort()
        self._thread.stop()
        self._commands_client.close()

    def _poll(self) -> bool:
        # After a failure, a request that does not wait shows soonest that the cloud is back.
        wait_s = 0.0 if self.fault is not None else self._wait_s
        changes = self._commands_client.fetch(self._commands.pending(), wait_s)
        self._thread.succeeded()
        self._commands.change(changes.give, changes.drop)
        if changes.give:
            log.info("commands fetched: nodes=%d", len(changes.give))
        # Wait until they are published, so that the next request reports it.
        for _ in range(_MAX_TICKS):
            if self._thread.stopping.wait(_TICK_S):
                break
            if all(published for _, _, published in self._commands.pending()):
                break
        return True
