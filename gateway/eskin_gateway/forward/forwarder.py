"""The thread between spool and cloud: send in order, forget only what the cloud answered for."""

from __future__ import annotations

import logging
import time
from threading import Event, Thread
from typing import TYPE_CHECKING, Final

import httpx

from eskin.errors import CloudError, SpoolError
from eskin.runtime.memory import HeapTrimmer
from eskin_gateway.forward.retry_queue import RetryQueue
from eskin_gateway.forward.unknown_nodes import UnknownNodes
from eskin_gateway.spool.batch import DeadLetter

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_gateway.backoff import Backoff
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.settings import CloudSection
    from eskin_gateway.spool.spool import Spool, Stored
    from eskin_gateway.upstream.certificates_client import Certificates
    from eskin_gateway.upstream.confirmations_client import Confirmations
    from eskin_gateway.upstream.ingest_client import Answer, Cloud

log = logging.getLogger(__name__)

_TOO_LARGE: Final = httpx.codes.REQUEST_ENTITY_TOO_LARGE
_TICK_S: Final = 0.25
_DRAIN_S: Final = 5.0
_COMPARE_S: Final = 300.0
_COMPARE_AGAIN_S: Final = 30.0
_FEW: Final = range(4, 64)
"""Such requests cost more for each message than to let some more of them come would. With fewer,
messages come too seldom for that."""
_REST_S: Final = 0.05
"""The rest after few is as long as their request took, but no longer than this."""


class Forwarder:
    """Sends the spool's messages until it is stopped; then for a short while what is left.

    Args:
        settings: Sizes of a request.
        spool: Where messages wait.
        cloud: Where they go.
        certificates: Has the cloud know the nodes.
        backoff: Between failures.
        metrics: What is counted.
        confirmations: Ask the cloud for what it confirmed; ``None``: nothing is compared.
        now: UTC ns.
    """

    def __init__(
        self,
        settings: CloudSection,
        *,
        spool: Spool,
        cloud: Cloud,
        certificates: Certificates,
        backoff: Backoff,
        metrics: Metrics,
        confirmations: Confirmations | None = None,
        now: Callable[[], int] = time.time_ns,
    ) -> None:
        self._settings = settings
        self._spool = spool
        self._cloud = cloud
        self._backoff = backoff
        self._metrics = metrics
        self._now = now
        self._confirmations = confirmations
        self._compare_at = 0.0
        self._missing: list[tuple[str, int, int, int]] = []
        self._most = settings.batch_messages
        self._deferred = RetryQueue()
        self._unknown = UnknownNodes(certificates)
        self._alone = False
        self._heap_trimmer = HeapTrimmer()
        self._failing = False
        self._stopping = Event()
        self.reachable: bool | None = None
        self.fault: str | None = None
        self._thread = Thread(target=self._run, name="forwarder", daemon=True)

    @property
    def left_out(self) -> int:
        """Messages in the spool that the cloud fails at, and that nothing waits behind."""
        return len(self._deferred)

    def start(self) -> None:
        """Work in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """Send what is left if the cloud takes it at once, and end the thread."""
        self._stopping.set()
        self._spool.filled.set()
        self._thread.join()

    def _run(self) -> None:
        deadline = float("inf")
        while True:
            ending = self._stopping.is_set()
            if ending:
                deadline = min(deadline, time.monotonic() + _DRAIN_S)
            begun = time.monotonic()
            try:
                sent = self.forward()
                failed = False
                if not ending:
                    self._compare()
            except (CloudError, SpoolError) as error:
                sent, failed = 0, True
                self._stopping.wait(self._note_failure(error))
            except Exception:  # the thread's outermost loop: what broke is told and counted
                sent, failed = 0, True
                log.exception("forwarding failed unexpectedly; trying again")
                self._metrics.cloud_failures.inc()
                self._stopping.wait(self._backoff.failed())
            if self._stopping.is_set() and (failed or time.monotonic() > deadline):
                return
            if ending and not sent:  # since the end was told; before, some may have come meanwhile
                return
            if sent in _FEW and sent < self._most:
                self._stopping.wait(min(time.monotonic() - begun, _REST_S))
            elif not sent and not failed:
                self._heap_trimmer.take(0)
                self._spool.filled.wait(_TICK_S)

    def _compare(self) -> None:
        """After a start or a failure, and now and then: has the cloud still what it confirmed?"""
        now = time.monotonic()
        if self._confirmations is None or now < self._compare_at:
            return
        self._compare_at = now + _COMPARE_S
        try:
            missing = self._confirmations.compare(self._spool.confirmed())
        except (CloudError, SpoolError) as error:
            self._compare_at = now + _COMPARE_AGAIN_S
            log.warning("what the cloud confirmed is not compared yet: error=%s", error)
            return
        for node, boot, first, last in missing:
            if (node, boot, first, last) not in self._missing:
                log.error(
                    "cloud lost what it had confirmed: node=%s boot=%d first=%d last=%d",
                    node,
                    boot,
                    first,
                    last,
                )
        self._missing = missing

    @property
    def missing(self) -> int:
        """Messages that the cloud confirmed and no longer has, by the latest comparison."""
        return sum(last - first + 1 for _, _, first, last in self._missing)

    def forward(self) -> int:
        """Send the oldest messages once; gives how many were settled.

        Raises:
            CloudError: The cloud did not answer as agreed.
            SpoolError: The spool cannot be read or written.
        """
        # Others come between two that are tried alone: the cloud may take long to fail at each.
        alone = None if self._alone else self._deferred.due()
        self._alone = alone is not None
        stored = [alone] if alone is not None else self._next()
        if not stored:
            return 0
        self._metrics.forwarded.inc(len(stored))
        try:
            answers = self._cloud.send([(message.node, message.body) for message in stored])
        except CloudError as error:
            return self._divide(stored, error)
        self._deferred.taken(stored)
        self._note_success()
        self._heap_trimmer.take(sum(len(message.body) for message in stored))
        self._settle(stored, answers)
        self._most = min(self._most * 2, self._settings.batch_messages)
        return len(stored)

    def _next(self) -> list[Stored]:
        """The oldest messages but those that are left out.

        Raises:
            CloudError: Nothing else is there to tell whose fault it is that it failed.
        """
        size = self._settings.batch_bytes
        aside = self._unknown.waiting()
        stored = self._spool.take(self._most, size, besides=self._deferred.ids, without=aside)
        if not stored and self._deferred.release_suspects():
            raise CloudError("the cloud fails at each message that waits")
        return stored

    def _divide(self, stored: list[Stored], error: CloudError) -> int:
        """The cloud did not take a request: send less, and find what it is that it cannot take.

        Raises:
            CloudError: There is to be a wait first.
        """
        halved = error.status in {None, httpx.codes.INTERNAL_SERVER_ERROR, _TOO_LARGE}
        if halved and len(stored) > 1:  # what it cannot do in time, it does twice
            self._most = len(stored) // 2
        elif error.status == _TOO_LARGE:
            self._spool.settle(stored, [self._letter(stored[0], str(error))])
            self._deferred.forget(stored[0])
            self._metrics.cloud_rejected.inc()
            return 1
        elif error.unanswered or error.status == httpx.codes.INTERNAL_SERVER_ERROR:
            if self._deferred.hold(stored[0]):
                self._metrics.cloud_failures.inc()
                return 1
            self._deferred.release_suspects()
        else:
            self._deferred.put_off(stored[0])
        raise error

    def _settle(self, stored: list[Stored], answers: list[Answer]) -> None:
        both = list(zip(stored, answers, strict=True))
        unknown = {message.node for message, answer in both if answer.result == "unknown_node"}
        pairs = [(message, answer) for message, answer in both if message.node not in unknown]
        stored, answers = [m for m, _ in pairs], [a for _, a in pairs]
        self._unknown.known({message.node for message in stored})
        rejected = [(m, a.reason or "no reason given") for m, a in pairs if a.result == "rejected"]
        letters = [self._letter(message, reason) for message, reason in rejected]
        confirmed = [m for m, a in pairs if a.result != "rejected"]
        self._spool.settle(stored, letters, confirmed=confirmed)
        for message, reason in rejected[:3]:
            log.warning("cloud rejected a message: node=%s reason=%r", message.node, reason[:200])
        count = [answer.result for answer in answers].count
        self._metrics.stored.inc(count("stored"))
        self._metrics.cloud_duplicate.inc(count("duplicate"))
        self._metrics.cloud_rejected.inc(len(rejected))
        if stored:
            self._metrics.latency.observe(max(0.0, (self._now() - stored[0].received) / 1e9))
        if unknown:
            self._unknown.present(unknown)
            self.fault = self.fault or self._unknown.fault

    def _letter(self, message: Stored, reason: str) -> DeadLetter:
        return DeadLetter(self._now(), message.node, f"cloud: {reason[:500]}", message.body)

    def _note_success(self) -> None:
        self._backoff.succeeded()
        if not self.reachable:
            log.info("cloud reached: %s", self._settings.url)
        self.reachable = True
        self._failing = False
        self.fault = self._deferred.fault or self._unknown.fault

    def _note_failure(self, error: CloudError | SpoolError) -> float:
        """Tell once per change; gives the seconds to wait."""
        self._metrics.cloud_failures.inc()
        self._compare_at = 0.0
        if not self._failing:
            log.warning("forwarding: %s; messages wait in the spool", error)
        self._failing = True
        self.fault = str(error)
        patience = None
        if isinstance(error, CloudError):
            self.reachable, patience = False, error.retry_after
        return self._backoff.failed(at_least=patience)
