"""The thread between inbox and spool: judge, commit, and only then answer."""

from __future__ import annotations

import logging
import time
from threading import Event, Thread
from typing import TYPE_CHECKING, Final

from eskin.errors import SpoolError
from gateway.reason import Reason

if TYPE_CHECKING:
    from collections.abc import Callable

    from gateway.answers import Answers
    from gateway.arrival import Arrival
    from gateway.batch import Batch
    from gateway.counters import Counters
    from gateway.dispatcher import Dispatcher
    from gateway.inbox import Inbox
    from gateway.intake import Intake, Outcome
    from gateway.settings import SpoolSection
    from gateway.spool import Spool

log = logging.getLogger(__name__)

_TICK_S: Final = 0.25
_RETRY_S: Final = 0.25
_RESTLESS_S: Final = 1.0
_COMPANY: Final = 4
"""Messages that make waiting for one commit worth while."""


class Worker:
    """Takes batches from the inbox until it is stopped, and then until the inbox is empty.

    Args:
        settings: Sizes of a batch.
        inbox: Where arrivals wait.
        intake: Judges them.
        spool: Makes them durable.
        answers: Given only then.
        dispatcher: Publishes commands meanwhile.
        counters: What is counted.
        clock: Monotonic seconds.
    """

    def __init__(
        self,
        settings: SpoolSection,
        *,
        inbox: Inbox,
        intake: Intake,
        spool: Spool,
        answers: Answers,
        dispatcher: Dispatcher,
        counters: Counters,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._settings = settings
        self._inbox = inbox
        self._intake = intake
        self._spool = spool
        self._answers = answers
        self._dispatcher = dispatcher
        self._counters = counters
        self._clock = clock
        self._taken = self._looked = clock()
        self._pace = 0.0
        self._stopping = Event()
        self.fault: str | None = None
        self._thread = Thread(target=self._run, name="worker", daemon=True)

    def start(self) -> None:
        """Work in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """Finish what is in the inbox, and end the thread."""
        self._stopping.set()
        self._thread.join()

    def _run(self) -> None:
        ended = False
        while not ended:
            arrivals = self._inbox.take(
                self._settings.batch_messages, linger_s=self._linger(), wait_s=_TICK_S
            )
            self._note_pace(len(arrivals))
            ended = not arrivals and self._stopping.is_set()
            if arrivals:
                self._counters.received.inc(len(arrivals))
                self.attempt(arrivals)
            try:
                self._look_around(idle=not arrivals)
                self._dispatcher.dispatch()
            except SpoolError as error:
                log.warning("commands not published, trying again: %s", error)
            except Exception:  # the thread's outermost loop, as in `attempt`
                log.exception("what has no message for a reason broke; trying again")

    def attempt(self, arrivals: list[Arrival]) -> None:
        """Process a batch, and where it breaks, each message for itself: one shall not hinder all.

        What breaks alone is told, counted, and not acknowledged to its node.
        """
        try:
            self.process(arrivals)
        except Exception:  # the thread's outermost loop: what nobody foresaw ends it not
            log.exception("batch broke: messages=%d", len(arrivals))
            self._intake.forget()
            if len(arrivals) > 1:
                for arrival in arrivals:
                    self.attempt([arrival])
                return
            self._counters.rejected(Reason.FAULT, 1)
            self._answers.release(arrivals)

    def _look_around(self, *, idle: bool) -> None:
        """Do what has no message for a reason, also where there is never a moment's rest."""
        if idle or self._clock() >= self._looked + _RESTLESS_S:
            self._looked = self._clock()
            self._answers.idle()

    def _linger(self) -> float:
        """How long to wait for company: not at all, where hardly any would come."""
        longest = self._settings.batch_ms / 1000.0
        return longest if self._pace * longest >= _COMPANY else 0.0

    def _note_pace(self, taken: int) -> None:
        now = self._clock()
        self._pace = taken / max(1e-6, now - self._taken)
        self._taken = now

    def process(self, arrivals: list[Arrival]) -> None:
        """Judge a batch, make it durable, and answer."""
        outcome = self._intake.sort(arrivals)
        batch = outcome.batch
        if (batch.nodes or batch.senders) and not self._commit(batch):
            # What was refused must not count as seen when its copies come.
            self._intake.forget()
            return
        self._intake.committed(batch)
        self._count(outcome)  # before the answers: who was answered finds himself counted
        self._dispatcher.note(outcome)
        self._answers.give(outcome, arrivals)

    def _commit(self, batch: Batch) -> bool:
        """Commit; while there is no room, hold the batch: unanswered, so that nodes keep it."""
        while True:
            try:
                self._spool.commit(batch)
            except SpoolError as error:
                self._refuse(error)
                if self._stopping.wait(_RETRY_S):
                    return False
                continue
            if self.fault is not None:
                log.info("accepting again: the spool has room")
                self.fault = None
            self._counters.batches.inc()
            return True

    def _refuse(self, error: SpoolError) -> None:
        self._counters.refusals.inc()
        if self.fault is None:
            log.error("accepting nothing: %s", error)
        self.fault = str(error)

    def _count(self, outcome: Outcome) -> None:
        self._counters.accepted.inc(len(outcome.batch.entries))
        self._counters.duplicate.inc(outcome.duplicates)
        for reason, count in outcome.rejected.items():
            self._counters.rejected(reason, count)
