"""The thread between receive queue and spool: validate, commit, then acknowledge."""

from __future__ import annotations

import logging
import time
from random import SystemRandom
from typing import TYPE_CHECKING, Final

from eskin.errors import SpoolError
from eskin.runtime.supervised import Backoff, Supervised
from eskin_gateway.metrics import RejectReason

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_gateway.commands.publisher import CommandPublisher
    from eskin_gateway.ingest.post_commit import PostCommit
    from eskin_gateway.ingest.validator import IngestResult, Validator
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.mqtt.receive_queue import ReceiveQueue
    from eskin_gateway.mqtt.transport import ReceivedMessage
    from eskin_gateway.settings import SpoolSection
    from eskin_gateway.spool.batch import Batch
    from eskin_gateway.spool.spool import Spool

log = logging.getLogger(__name__)

_TICK_S: Final = 0.25
_RETRY_S: Final = 0.25
_PERIODIC_S: Final = 1.0
_MIN_GROUP: Final = 4
"""Expected messages for which a commit waits."""


class CommitLoop:
    """Takes batches from the receive queue until it is stopped and the queue is empty.

    Args:
        settings: Sizes of a batch.
        receive_queue: Holds received messages.
        validator: Validates them.
        spool: Makes them durable.
        post_commit: Acknowledges and publishes what is durable.
        command_publisher: Publishes commands after each batch.
        metrics: Counts messages.
        clock: Monotonic seconds.

    Attributes:
        fault: Why nothing can be committed.
    """

    def __init__(
        self,
        settings: SpoolSection,
        *,
        receive_queue: ReceiveQueue,
        validator: Validator,
        spool: Spool,
        post_commit: PostCommit,
        command_publisher: CommandPublisher,
        metrics: Metrics,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._settings = settings
        self._receive_queue = receive_queue
        self._validator = validator
        self._spool = spool
        self._post_commit = post_commit
        self._command_publisher = command_publisher
        self._metrics = metrics
        self._clock = clock
        self._last_take = self._last_periodic = clock()
        self._rate = 0.0
        self.fault: str | None = None
        self._thread = Supervised(
            "commit_loop",
            self._step,
            backoff=Backoff(0.01, _RETRY_S, random=SystemRandom()),
            drain_s=float("inf"),
        )

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Process what is in the receive queue, and end the thread."""
        self._thread.stop()

    def _step(self) -> bool:
        received_messages = self._receive_queue.take(
            self._settings.batch_messages, linger_s=self._linger(), wait_s=_TICK_S
        )
        now = self._clock()
        self._rate = len(received_messages) / max(1e-6, now - self._last_take)
        self._last_take = now
        if received_messages:
            self._metrics.received.inc(len(received_messages))
            self.process_or_split(received_messages)
        if not received_messages or now >= self._last_periodic + _PERIODIC_S:
            self._last_periodic = now
            self._post_commit.run_periodic()
        self._command_publisher.publish_due()
        self._thread.succeeded()
        return bool(received_messages)

    def process_or_split(self, received_messages: list[ReceivedMessage]) -> None:
        """Process a batch; after an unexpected error, process each message by itself.

        A message that fails by itself is rejected, and not acknowledged to its node.
        """
        try:
            self.process(received_messages)
        except Exception:  # one message must not block all others
            log.exception("batch failed: messages=%d", len(received_messages))
            self._validator.reset()
            if len(received_messages) > 1:
                for message in received_messages:
                    self.process_or_split([message])
                return
            self._metrics.rejected(RejectReason.INTERNAL_ERROR)
            self._post_commit.release(received_messages)

    def _linger(self) -> float:
        """Seconds to wait for more messages: none if few would come."""
        longest = self._settings.batch_ms / 1000.0
        return longest if self._rate * longest >= _MIN_GROUP else 0.0

    def process(self, received_messages: list[ReceivedMessage]) -> None:
        """Validate a batch, commit it, and acknowledge."""
        result = self._validator.validate(received_messages)
        batch = result.batch
        if (batch.nodes or batch.certificates) and not self._commit(batch):
            # Positions that are not durable must not count as duplicates.
            self._validator.reset()
            return
        self._validator.committed(batch)
        self._count(result)  # before the acknowledgements, so that they are never ahead of it
        self._command_publisher.note_results(result.messages)
        self._post_commit.run(result, received_messages)

    def _commit(self, batch: Batch) -> bool:
        """Commit. While the spool is full, hold the batch unacknowledged, so nodes keep it."""
        while True:
            try:
                self._spool.commit(batch)
            except SpoolError as error:
                self._metrics.commit_failures.inc()
                if self.fault is None:
                    log.error("commits fail: error=%s", error)  # noqa: TRY400 - no traceback
                self.fault = str(error)
                if self._thread.stopping.wait(_RETRY_S):
                    return False
                continue
            if self.fault is not None:
                log.info("commits succeed again")
                self.fault = None
            self._metrics.batches.inc()
            return True

    def _count(self, result: IngestResult) -> None:
        self._metrics.accepted.inc(len(result.batch.messages))
        self._metrics.duplicate.inc(result.duplicates)
        for reason, count in result.rejected.items():
            self._metrics.rejected(reason, count)
