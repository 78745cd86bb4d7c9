"""Work that is retried after failures: a thread that repeats one step, and its log."""

from __future__ import annotations

import logging
import time
from threading import Event, Thread
from typing import TYPE_CHECKING, Final

from eskin.errors import CloudError, EskinError

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

log = logging.getLogger(__name__)

MAX_RETRY_AFTER_S: Final = 3600.0
"""Longest wait that a peer's Retry-After can ask for."""


class Backoff:
    """Exponential delays with jitter, so that many clients do not retry at the same instant.

    Args:
        first: Seconds before the first retry.
        most: Most seconds before a retry.
        random: Source of jitter.
    """

    def __init__(self, first: float, most: float, *, random: Random) -> None:
        self._first = first
        self._most = most
        self._random = random
        self._failures = 0

    def failed(self, *, at_least: float | None = None) -> float:
        """Count a failure and return the seconds to wait.

        Args:
            at_least: Retry-After of the peer, in seconds.
        """
        # The exponent is bounded, or a long outage would overflow the float.
        limit = min(self._first * 2.0 ** min(self._failures, 30), self._most)
        self._failures += 1
        delay = limit * self._random.uniform(0.5, 1.0)
        return max(delay, min(at_least or 0.0, MAX_RETRY_AFTER_S))

    def succeeded(self) -> None:
        """Begin again with the first delay."""
        self._failures = 0


class FaultLog:
    """Logs a failure when it begins or changes, not at each retry.

    A failure that is neither an `EskinError` nor an `OSError` is unexpected, and logged with its
    traceback.

    Attributes:
        faults: What fails now, by the name of the work.
    """

    def __init__(self) -> None:
        self.faults: dict[str, str] = {}

    def failed(self, work: str, error: Exception) -> bool:
        """Log a failure, if it is new; returns whether it was expected."""
        expected = isinstance(error, EskinError | OSError)
        fault = str(error) if expected else f"unexpected error: {type(error).__name__}"
        if fault != self.faults.get(work):
            level, trace = (logging.WARNING, None) if expected else (logging.ERROR, error)
            log.log(level, "retrying: work=%s error=%s", work, fault, exc_info=trace)
        self.faults[work] = fault
        return expected

    def succeeded(self, work: str) -> None:
        """Forget a failure that is over."""
        self.faults.pop(work, None)

    def attempt(self, work: str, do: Callable[[], object]) -> None:
        """Do work that the caller retries later, whatever error it raises."""
        try:
            do()
        except Exception as error:  # noqa: BLE001 - the caller goes on after any error
            self.failed(work, error)
        else:
            self.succeeded(work)


class Supervised:
    """Runs a step in a thread until `stop`; no error ends the thread.

    Failures are logged as `FaultLog` does. The step calls `succeeded` when its work is done.

    Args:
        name: Name of the thread and in the log.
        step: One round; returns whether the next round should follow at once.
        backoff: Delays after failures.
        idle_s: Seconds between rounds that leave nothing to do.
        drain_s: Seconds for further rounds after `stop`, while there is something to do.
        on_failure: Called for each failure, for example to count it.

    Attributes:
        stopping: Set by `stop`. A step that waits should wait for it.
    """

    def __init__(
        self,
        name: str,
        step: Callable[[], bool],
        *,
        backoff: Backoff,
        idle_s: float = 0.0,
        drain_s: float = 0.0,
        on_failure: Callable[[Exception], object] = lambda _: None,
    ) -> None:
        self._name = name
        self._step = step
        self._backoff = backoff
        self._idle_s = idle_s
        self._drain_s = drain_s
        self._on_failure = on_failure
        self.stopping = Event()
        self._log = FaultLog()
        self._thread = Thread(target=self._run, name=name, daemon=True)

    @property
    def fault(self) -> str | None:
        """The last failure, or ``None`` after a success."""
        return self._log.faults.get(self._name)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread after the current round, or after it has drained."""
        self.stopping.set()
        if self._thread.is_alive():
            self._thread.join()

    def succeeded(self) -> None:
        """Clear the fault and reset the backoff."""
        self._backoff.succeeded()
        self._log.succeeded(self._name)

    def _run(self) -> None:
        deadline = float("inf")
        while True:
            stopping = self.stopping.is_set()
            if stopping:
                deadline = min(deadline, time.monotonic() + self._drain_s)
                if not self._drain_s:
                    return
            more, delay = False, self._idle_s
            try:
                more = self._step()
            except Exception as error:  # noqa: BLE001 - the one loop that survives any error
                delay = self._failed(error)
            if stopping and (not more or time.monotonic() >= deadline):
                return
            if not more and delay:
                self.stopping.wait(delay)

    def _failed(self, error: Exception) -> float:
        self._log.failed(self._name, error)
        self._on_failure(error)
        return self._backoff.failed(
            at_least=error.retry_after if isinstance(error, CloudError) else None
        )
