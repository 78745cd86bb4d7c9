"""The thread between inbox and spool: judge, commit, and only then answer."""

from __future__ import annotations

import logging
import time
from threading import Event, Thread
from typing import TYPE_CHECKING, Final

from eskin.errors import SpoolError
from eskin_gateway.reject_reason import RejectReason

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_gateway.commands.publisher import CommandPublisher
    from eskin_gateway.ingest.post_commit import PostCommit
    from eskin_gateway.ingest.validator import IngestResult, Validator
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.mqtt.receive_queue import ReceiveQueue
    from eskin_gateway.mqtt.received_message import ReceivedMessage
    from eskin_gateway.settings import SpoolSection
    from eskin_gateway.spool.batch import Batch
    from eskin_gateway.spool.spool import Spool

log = logging.getLogger(__name__)

_TICK_S: Final = 0.25
_RETRY_S: Final = 0.25
_RESTLESS_S: Final = 1.0
_COMPANY: Final = 4
"""Messages that make waiting for one commit worth while."""


class CommitLoop:
    """Takes batches from the inbox until it is stopped, and then until the inbox is empty.

    Args:
        settings: Sizes of a batch.
        receive_queue: Where arrivals wait.
        validator: Judges them.
        spool: Makes them durable.
        answers: Given only then.
        command_publisher: Publishes commands meanwhile.
        metrics: What is counted.
        clock: Monotonic seconds.
    """

    def __init__(
        self,
        settings: SpoolSection,
        *,
        receive_queue: ReceiveQueue,
        validator: Validator,
        spool: Spool,
        answers: PostCommit,
        command_publisher: CommandPublisher,
        metrics: Metrics,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._settings = settings
        self._receive_queue = receive_queue
        self._validator = validator
        self._spool = spool
        self._answers = answers
        self._command_publisher = command_publisher
        self._metrics = metrics
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
            received_messages = self._receive_queue.take(
                self._settings.batch_messages, linger_s=self._linger(), wait_s=_TICK_S
            )
            self._note_pace(len(received_messages))
            ended = not received_messages and self._stopping.is_set()
            if received_messages:
                self._metrics.received.inc(len(received_messages))
                self.attempt(received_messages)
            try:
                self._look_around(idle=not received_messages)
                self._command_publisher.dispatch()
            except SpoolError as error:
                log.warning("commands not published, trying again: %s", error)
            except Exception:  # the thread's outermost loop, as in `attempt`
                log.exception("what has no message for a reason broke; trying again")

    def attempt(self, received_messages: list[ReceivedMessage]) -> None:
        """Process a batch, and where it breaks, each message for itself: one shall not hinder all.

        What breaks alone is told, counted, and not acknowledged to its node.
        """
        try:
            self.process(received_messages)
        except Exception:  # the thread's outermost loop: what nobody foresaw ends it not
            log.exception("batch broke: messages=%d", len(received_messages))
            self._validator.forget()
            if len(received_messages) > 1:
                for received_message in received_messages:
                    self.attempt([received_message])
                return
            self._metrics.rejected(RejectReason.FAULT, 1)
            self._answers.release(received_messages)

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

    def process(self, received_messages: list[ReceivedMessage]) -> None:
        """Judge a batch, make it durable, and answer."""
        outcome = self._validator.sort(received_messages)
        batch = outcome.batch
        if (batch.nodes or batch.node_certificates) and not self._commit(batch):
            # What was refused must not count as seen when its copies come.
            self._validator.forget()
            return
        self._validator.committed(batch)
        self._count(outcome)  # before the answers: who was answered finds himself counted
        self._command_publisher.note(outcome.messages)
        self._answers.give(outcome, received_messages)

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
            self._metrics.batches.inc()
            return True

    def _refuse(self, error: SpoolError) -> None:
        self._metrics.refusals.inc()
        if self.fault is None:
            log.error("accepting nothing: %s", error)
        self.fault = str(error)

    def _count(self, outcome: IngestResult) -> None:
        self._metrics.accepted.inc(len(outcome.batch.entries))
        self._metrics.duplicate.inc(outcome.duplicates)
        for reason, count in outcome.rejected.items():
            self._metrics.rejected(reason, count)
