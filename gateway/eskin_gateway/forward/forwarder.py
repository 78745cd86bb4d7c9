"""The thread between spool and cloud: sends in order, deletes what the cloud answered for."""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Final

import httpx

from eskin.errors import CloudError, SpoolError
from eskin.runtime.memory import HeapTrimmer
from eskin.runtime.supervised import Supervised
from eskin_gateway.forward.retry_queue import RetryQueue, UnknownNodes
from eskin_gateway.spool.batch import DeadLetter

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin.runtime.supervised import Backoff
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.settings import CloudSection
    from eskin_gateway.spool.batch import SpoolMessage
    from eskin_gateway.spool.spool import Spool
    from eskin_gateway.upstream.certificates_client import CertificatesClient
    from eskin_gateway.upstream.confirmations_client import ConfirmationsClient
    from eskin_gateway.upstream.ingest_client import IngestClient, ItemResult

log = logging.getLogger(__name__)

_TOO_LARGE: Final = httpx.codes.REQUEST_ENTITY_TOO_LARGE
_TICK_S: Final = 0.25
_DRAIN_S: Final = 5.0
_COMPARE_S: Final = 300.0
_COMPARE_RETRY_S: Final = 30.0
_SMALL_BATCH: Final = range(4, 64)
"""Such requests cost more for each message than a pause that lets more messages come. With fewer,
messages are too rare for that."""
_MAX_PAUSE_S: Final = 0.05
"""The pause after a small batch is as long as its request took, but no longer than this."""


class Forwarder:
    """Sends the spool's messages until it is stopped, and what is left for a short time.

    Args:
        settings: Sizes of a request.
        spool: Holds the messages.
        ingest_client: Sends them to the cloud.
        certificates_client: Registers nodes at the cloud.
        backoff: Delays after failures.
        metrics: Counts messages.
        confirmations_client: Finds lost messages, if given.
        now: UTC ns.

    Attributes:
        reachable: Whether the cloud answered; ``None`` before the first request.
    """

    def __init__(
        self,
        settings: CloudSection,
        *,
        spool: Spool,
        ingest_client: IngestClient,
        certificates_client: CertificatesClient,
        backoff: Backoff,
        metrics: Metrics,
        confirmations_client: ConfirmationsClient | None = None,
        now: Callable[[], int] = time.time_ns,
    ) -> None:
        self._settings = settings
        self._spool = spool
        self._ingest_client = ingest_client
        self._metrics = metrics
        self._now = now
        self._confirmations_client = confirmations_client
        self._compare_at = 0.0
        self._missing: list[tuple[str, int, int, int]] = []
        self._batch_messages = settings.batch_messages
        self._retry_queue = RetryQueue()
        self._unknown_nodes = UnknownNodes(certificates_client)
        self._retried = False
        self._heap_trimmer = HeapTrimmer()
        self.reachable: bool | None = None
        self._thread = Supervised(
            "forwarder",
            self._step,
            backoff=backoff,
            drain_s=_DRAIN_S,
            on_failure=self._note_failure,
        )

    @property
    def retrying(self) -> int:
        """Messages in the spool at which the cloud fails."""
        return len(self._retry_queue)

    @property
    def missing(self) -> int:
        """Messages that the cloud confirmed and no longer has, by the latest comparison."""
        return sum(last - first + 1 for _, _, first, last in self._missing)

    @property
    def fault(self) -> str | None:
        """Why messages wait in the spool."""
        return self._thread.fault or self._retry_queue.fault or self._unknown_nodes.fault

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Send what is left if the cloud takes it, and end the thread."""
        self._thread.stopping.set()
        self._spool.filled.set()
        self._thread.stop()

    def _step(self) -> bool:
        begun = time.monotonic()
        sent = self.forward()
        stopping = self._thread.stopping
        if not stopping.is_set():
            self._compare()
            if sent in _SMALL_BATCH and sent < self._batch_messages:
                stopping.wait(min(time.monotonic() - begun, _MAX_PAUSE_S))
            elif not sent:
                self._heap_trimmer.take(0)
                self._spool.filled.wait(_TICK_S)
        return sent > 0

    def _compare(self) -> None:
        """After a start or failure, and periodically: find what the cloud lost."""
        now = time.monotonic()
        if self._confirmations_client is None or now < self._compare_at:
            return
        self._compare_at = now + _COMPARE_S
        try:
            missing = self._confirmations_client.find_missing(self._spool.confirmed())
        except (CloudError, SpoolError) as error:
            self._compare_at = now + _COMPARE_RETRY_S
            log.warning("comparison with the cloud failed: error=%s", error)
            return
        for lost in missing:
            if lost not in self._missing:
                log.error("cloud lost messages: node=%s boot=%d first=%d last=%d", *lost)
        self._missing = missing

    def forward(self) -> int:
        """Send the oldest messages once; return how many were settled.

        Raises:
            CloudError: The request failed.
            SpoolError: The spool cannot be read or written.
        """
        # New messages come between two retries: the cloud may take long to fail at each.
        retry = None if self._retried else self._retry_queue.due()
        self._retried = retry is not None
        messages = [retry] if retry is not None else self._take()
        if not messages:
            return 0
        self._metrics.forwarded.inc(len(messages))
        try:
            results = self._ingest_client.send([(m.node, m.body) for m in messages])
        except CloudError as error:
            return self._isolate(messages, error)
        self._retry_queue.succeeded(messages)
        self._thread.succeeded()
        if not self.reachable:
            log.info("cloud reached: url=%s", self._settings.url)
        self.reachable = True
        self._heap_trimmer.take(sum(len(message.body) for message in messages))
        self._settle(messages, results)
        self._batch_messages = min(self._batch_messages * 2, self._settings.batch_messages)
        return len(messages)

    def _take(self) -> list[SpoolMessage]:
        """Read the oldest messages that are not left out.

        Raises:
            CloudError: All waiting messages failed, so the cloud fails and not the messages.
        """
        messages = self._spool.take(
            self._batch_messages,
            self._settings.batch_bytes,
            without_ids=self._retry_queue.ids,
            without_nodes=self._unknown_nodes.rejected(),
        )
        if not messages and self._retry_queue.release_unconfirmed():
            raise CloudError("the cloud fails at each message that waits")
        return messages

    def _isolate(self, messages: list[SpoolMessage], error: CloudError) -> int:
        """After a failed request, halve the next one, until a single message fails.

        Raises:
            CloudError: The next request must wait for the backoff.
        """
        first = messages[0]
        halved = error.status in {None, httpx.codes.INTERNAL_SERVER_ERROR, _TOO_LARGE}
        if halved and len(messages) > 1:
            self._batch_messages = len(messages) // 2
        elif error.status == _TOO_LARGE:
            self._spool.settle(messages, [self._dead_letter(first, str(error))])
            self._retry_queue.remove(first)
            self._metrics.cloud_rejected.inc()
            return 1
        elif error.unanswered or error.status == httpx.codes.INTERNAL_SERVER_ERROR:
            if self._retry_queue.add(first):
                self._metrics.cloud_failures.inc()
                return 1
            self._retry_queue.release_unconfirmed()
        else:
            self._retry_queue.delay(first)
        raise error

    def _settle(self, messages: list[SpoolMessage], results: list[ItemResult]) -> None:
        pairs = list(zip(messages, results, strict=True))
        unknown = {m.node for m, r in pairs if r.result == "unknown_node"}
        pairs = [(m, r) for m, r in pairs if m.node not in unknown]
        settled = [message for message, _ in pairs]
        self._unknown_nodes.known({message.node for message in settled})
        rejected = [(m, r.reason or "no reason given") for m, r in pairs if r.result == "rejected"]
        self._spool.settle(
            settled,
            [self._dead_letter(message, reason) for message, reason in rejected],
            confirmed=[m for m, r in pairs if r.result != "rejected"],
        )
        for message, reason in rejected[:3]:
            log.warning("cloud rejected a message: node=%s reason=%r", message.node, reason[:200])
        count = [r.result for _, r in pairs].count
        self._metrics.stored.inc(count("stored"))
        self._metrics.cloud_duplicate.inc(count("duplicate"))
        self._metrics.cloud_rejected.inc(len(rejected))
        if settled:
            self._metrics.latency.observe(max(0.0, (self._now() - settled[0].received) / 1e9))
        if unknown:
            self._unknown_nodes.register(unknown)

    def _dead_letter(self, message: SpoolMessage, reason: str) -> DeadLetter:
        return DeadLetter(self._now(), message.node, f"cloud: {reason[:500]}", message.body)

    def _note_failure(self, error: Exception) -> None:
        self._metrics.cloud_failures.inc()
        self._compare_at = 0.0
        if isinstance(error, CloudError):
            self.reachable = False
