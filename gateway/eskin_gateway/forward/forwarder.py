"""The thread between spool and cloud: sends in order, deletes what the cloud answered for.

Messages at which the cloud fails while it takes others are left out, and retried by themselves.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import httpx

from eskin.errors import CloudError, SpoolError
from eskin.runtime.memory import HeapTrimmer
from eskin.runtime.supervised import Supervised
from eskin_gateway.spool.batch import DeadLetter

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from eskin.runtime.supervised import Backoff
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.settings import CloudSection
    from eskin_gateway.spool.batch import SpoolMessage
    from eskin_gateway.spool.spool import Spool
    from eskin_gateway.upstream.certificates_client import CertificatesClient
    from eskin_gateway.upstream.confirmations_client import ConfirmationsClient
    from eskin_gateway.upstream.descriptions_client import DescriptionsClient, Posted
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
_MAX_MESSAGES: Final = 16
"""If more messages fail, one after another, the cloud fails and not the messages."""
_MAX_DELAY_S: Final = 60.0
_MAX_DOUBLINGS: Final = 6
"""Bounds the exponent of the delay."""
_NODE_DELAY_S: Final = 60.0
_LEAST_DEFERRAL_S: Final = 1.0


@dataclass(slots=True)
class _Retry:
    """A message that is retried by itself.

    Attributes:
        message: As it is in the spool.
        failures: How often it failed although the cloud took others.
        due: When it is retried, in the clock's seconds; ``None`` until the cloud takes another one.
    """

    message: SpoolMessage
    failures: int = 0
    due: float | None = None


class RetryQueue:
    """Messages at which the cloud fails, each by itself.

    A single failure does not show that the message causes it: the cloud may fail at all messages.
    So a failed message is only left out until the cloud takes another one. From then on it is
    retried with growing delays. It stays in the spool; after a restart it fails again.

    Args:
        clock: Monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._retries: dict[int, _Retry] = {}

    @property
    def ids(self) -> tuple[int, ...]:
        """Rows of the messages."""
        return tuple(self._retries)

    def __len__(self) -> int:
        return len(self._retries)

    @property
    def fault(self) -> str | None:
        """What fails, or ``None`` if the queue is empty."""
        if not self._retries:
            return None
        message = next(iter(self._retries.values())).message
        return (
            f"the cloud fails at {len(self)} message(s), one of {message.node}, while it takes "
            "others: they stay in the spool and are retried; see the cloud's log"
        )

    def due(self) -> SpoolMessage | None:
        """A message to retry now, by itself."""
        now = self._clock()
        for retry in self._retries.values():
            if retry.due is not None and retry.due <= now:
                return retry.message
        return None

    def add(self, message: SpoolMessage) -> bool:
        """Add a message that failed by itself; return whether others may be sent without it."""
        if message.id in self._retries:
            self.delay(message)
        elif len(self) >= _MAX_MESSAGES:
            return False
        else:
            self._retries[message.id] = _Retry(message)
        return True

    def delay(self, message: SpoolMessage) -> None:
        """Double the delay of a message that failed again, and move it to the end."""
        retry = self._retries.get(message.id)
        if retry is None or retry.due is None:
            return
        self._retries[message.id] = self._retries.pop(message.id)
        retry.failures = min(retry.failures + 1, _MAX_DOUBLINGS)
        retry.due = self._clock() + min(2.0**retry.failures, _MAX_DELAY_S)

    def remove(self, message: SpoolMessage) -> None:
        """Remove a message that has left the spool."""
        self._retries.pop(message.id, None)

    def release_unconfirmed(self) -> bool:
        """Remove messages without a delay; return whether there were any."""
        unconfirmed = [row for row, retry in self._retries.items() if retry.due is None]
        for row in unconfirmed:
            del self._retries[row]
        return bool(unconfirmed)

    def succeeded(self, messages: Sequence[SpoolMessage]) -> None:
        """Note that the cloud took messages: those that failed are retried now."""
        for message in messages:
            self.remove(message)
        for retry in self._retries.values():
            if retry.due is None:
                log.warning("cloud fails at a message: node=%s", retry.message.node)
                retry.due = self._clock()


class UnknownNodes:
    """Registers nodes at the cloud, and leaves out those whose certificate it rejects.

    Their messages stay in the spool and are retried each minute.

    Args:
        certificates_client: Registers certificates.
        clock: Monotonic seconds.
    """

    def __init__(
        self, certificates_client: CertificatesClient, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._certificates_client = certificates_client
        self._clock = clock
        self._registered: set[str] = set()
        self._rejected: dict[str, tuple[float, str]] = {}

    def rejected(self) -> list[str]:
        """Nodes whose messages are left out now."""
        now = self._clock()
        for node in [node for node, (due, _) in self._rejected.items() if due <= now]:
            del self._rejected[node]
        return list(self._rejected)

    def register(self, nodes: Collection[str]) -> None:
        """Register the certificates of nodes that the cloud does not know.

        Raises:
            CloudError: The request failed.
            SpoolError: The spool cannot be read.
        """
        rejected = dict.fromkeys(self._registered.intersection(nodes), "it is unknown still")
        rejected |= self._certificates_client.register(set(nodes) - self._registered)
        due = self._clock() + _NODE_DELAY_S
        for node, reason in rejected.items():
            self._rejected[node] = due, reason
            log.warning("cloud rejects a certificate: node=%s reason=%s", node, reason)
        self._registered -= rejected.keys()
        self._registered |= set(nodes) - rejected.keys()

    def known(self, nodes: Collection[str]) -> None:
        """Note that the cloud took messages of these nodes."""
        self._registered -= set(nodes)

    @property
    def fault(self) -> str | None:
        """What is rejected, or ``None``."""
        if not self._rejected:
            return None
        node, (_, reason) = next(iter(self._rejected.items()))
        return (
            f"the cloud rejects {len(self._rejected)} node(s), one of them {node}: {reason}; their "
            "messages stay in the spool"
        )


class UnknownLayouts:
    """Posts descriptions that the cloud lacks, and leaves out nodes for which that is in vain.

    Their messages stay in the spool and are retried each minute.

    Args:
        descriptions_client: Posts descriptions.
        clock: Monotonic seconds.
    """

    def __init__(
        self, descriptions_client: DescriptionsClient, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._descriptions_client = descriptions_client
        self._clock = clock
        self._posted: dict[tuple[str, bytes], float] = {}
        self._left_out: dict[str, float] = {}

    def left_out(self) -> list[str]:
        """Nodes whose messages are left out now."""
        now = self._clock()
        self._left_out = {node: due for node, due in self._left_out.items() if due > now}
        return list(self._left_out)

    def post(self, wanted: Collection[tuple[str, bytes]]) -> dict[tuple[str, bytes], Posted]:
        """Post descriptions that the cloud lacks, and return what became of each.

        Raises:
            CloudError: The request failed.
            SpoolError: The spool cannot be read.
        """
        now = self._clock()
        self._posted = {key: at for key, at in self._posted.items() if now < at + _NODE_DELAY_S}
        for node, name in self._posted.keys() & set(wanted):
            if node not in self._left_out:
                log.warning("cloud lacks what it took: node=%s description=%s", node, name.hex())
            self._left_out[node] = now + _NODE_DELAY_S
        due = [key for key in wanted if key[0] not in self._left_out]
        posted = self._descriptions_client.post(due)
        taken = {key for key, each in posted.items() if each.result in {"stored", "duplicate"}}
        self._posted |= dict.fromkeys(taken, now)
        return posted

    @property
    def fault(self) -> str | None:
        """What is in vain, or ``None``."""
        if not self._left_out:
            return None
        return (
            f"the cloud lacks layouts that it took, of {len(self._left_out)} node(s), one of them "
            f"{next(iter(self._left_out))}: their messages stay in the spool; see the cloud's log"
        )


class DeferredNodes:
    """Leaves out nodes whose messages the cloud cannot store now, while it stores those of others.

    Their messages stay in the spool. They are sent again after a time in which the cloud can store
    four batches of the others, however long it took to answer.

    Args:
        clock: Monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._deferred: dict[str, tuple[float, str]] = {}

    def left_out(self) -> list[str]:
        """Nodes whose messages are left out now."""
        now = self._clock()
        self._deferred = {node: each for node, each in self._deferred.items() if each[0] > now}
        return list(self._deferred)

    def defer(self, reasons: Mapping[str, str], took_s: float) -> None:
        """Leave out nodes for a time.

        Args:
            reasons: Why the cloud stores nothing of each node now.
            took_s: How long the cloud took to answer.
        """
        due = self._clock() + min(max(_LEAST_DEFERRAL_S, 4 * took_s), _NODE_DELAY_S)
        for node, reason in reasons.items():
            self._deferred[node] = due, reason
        log.warning("cloud defers messages: nodes=%d reason=%s", len(reasons), reason)

    @property
    def fault(self) -> str | None:
        """What is deferred, or ``None``."""
        if not self._deferred:
            return None
        node, (_, reason) = next(iter(self._deferred.items()))
        return (
            f"the cloud stores nothing now of {len(self._deferred)} node(s), one of them {node}: "
            f"{reason}; their messages stay in the spool and are sent again"
        )


class Forwarder:
    """Sends the spool's messages until it is stopped, and what is left for a short time.

    Args:
        settings: Sizes of a request.
        spool: Holds the messages.
        ingest_client: Sends them to the cloud.
        certificates_client: Registers nodes at the cloud.
        descriptions_client: Posts the layouts that the cloud lacks.
        backoff: Delays after failures.
        metrics: Counts messages.
        confirmations_client: Finds lost messages, if given.
        confirm_erasures: Called before each request (`SubjectSync.confirm_erasures`), if given.
        clock: Monotonic seconds.
        now: UTC ns.

    Attributes:
        reachable: Whether the cloud answered; ``None`` before the first request.
    """

    def __init__(  # noqa: PLR0913 - all of the cloud that it posts to
        self,
        settings: CloudSection,
        *,
        spool: Spool,
        ingest_client: IngestClient,
        certificates_client: CertificatesClient,
        descriptions_client: DescriptionsClient,
        backoff: Backoff,
        metrics: Metrics,
        confirmations_client: ConfirmationsClient | None = None,
        confirm_erasures: Callable[[], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
        now: Callable[[], int] = time.time_ns,
    ) -> None:
        self._settings = settings
        self._spool = spool
        self._ingest_client = ingest_client
        self._metrics = metrics
        self._clock = clock
        self._now = now
        self._confirmations_client = confirmations_client
        self._confirm_erasures = confirm_erasures
        self._compare_at = 0.0
        self._missing: list[tuple[str, int, int, int]] = []
        self._batch_messages = settings.batch_messages
        self._retry_queue = RetryQueue(clock)
        self._unknown_nodes = UnknownNodes(certificates_client, clock)
        self._unknown_layouts = UnknownLayouts(descriptions_client, clock)
        self._deferred_nodes = DeferredNodes(clock)
        self._retried = False
        self._refused = False
        self._heap_trimmer = HeapTrimmer()
        self.reachable: bool | None = None
        self._thread = Supervised(
            "forwarder",
            self._step,
            backoff=backoff,
            drain_s=_DRAIN_S,
            on_failure=self.note_failure,
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
        return (
            self._thread.fault
            or self._retry_queue.fault
            or self._unknown_nodes.fault
            or self._unknown_layouts.fault
            or self._deferred_nodes.fault
        )

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Send what is left if the cloud takes it, and end the thread."""
        self._thread.stopping.set()
        self._spool.filled.set()
        self._thread.stop()

    def _step(self) -> bool:
        begun = self._clock()
        sent = self.forward()
        stopping = self._thread.stopping
        if not stopping.is_set():
            self.compare()
            if sent in _SMALL_BATCH and sent < self._batch_messages:
                stopping.wait(min(self._clock() - begun, _MAX_PAUSE_S))
            elif not sent:
                self._heap_trimmer.take(0)
                self._spool.filled.wait(_TICK_S)
        return sent > 0

    def compare(self) -> None:
        """After a start or failure, and periodically: find what the cloud lost."""
        now = self._clock()
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
        """Send the oldest messages once, each to its cloud; return how many were settled.

        Raises:
            CloudError: A request failed.
            SpoolError: The spool cannot be read or written.
        """
        # New messages come between two retries: the cloud may take long to fail at each.
        retry = None if self._retried else self._retry_queue.due()
        self._retried = retry is not None
        messages = [retry] if retry is not None else self._take()
        if messages and self._confirm_erasures is not None:
            self._confirm_erasures()
        return sum([self._send(share) for share in self._ingest_client.shares(messages)])

    def _send(self, messages: list[SpoolMessage]) -> int:
        """Send messages of one cloud; return how many were settled.

        Raises:
            CloudError: The request failed.
            SpoolError: The spool cannot be written.
        """
        self._metrics.forwarded.inc(len(messages))
        begun = self._clock()
        try:
            results = self._ingest_client.send([(m.node, m.body) for m in messages])
        except CloudError as error:
            return self._isolate(messages, error, self._clock() - begun)
        self._refused = False
        self._retry_queue.succeeded(messages)
        self._thread.succeeded()
        if not self.reachable:
            log.info("cloud reached: url=%s", self._ingest_client.url)
        self.reachable = True
        self._heap_trimmer.take(sum(len(message.body) for message in messages))
        later = {
            m.node: r.reason or "" for m, r in zip(messages, results, strict=True) if r.is_later
        }
        if later:
            self._deferred_nodes.defer(later, self._clock() - begun)
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
            without_nodes={
                *self._unknown_nodes.rejected(),
                *self._unknown_layouts.left_out(),
                *self._deferred_nodes.left_out(),
            },
        )
        if not messages and self._retry_queue.release_unconfirmed():
            raise CloudError("the cloud fails at each message that waits")
        return messages

    def _isolate(self, messages: list[SpoolMessage], error: CloudError, took_s: float) -> int:
        """After a failed request, halve the next one, until a single message fails.

        A cloud that can store none of a request answers 503, also where it could store messages of
        other nodes: these are sent before a pause.

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
            busy = error.status == httpx.codes.SERVICE_UNAVAILABLE
            if busy and not (self._retried or self._refused):
                self._refused = True
                self._metrics.cloud_failures.inc()
                self._deferred_nodes.defer({m.node: str(error) for m in messages}, took_s)
                return len(messages)
        raise error

    def _settle(self, messages: list[SpoolMessage], results: list[ItemResult]) -> None:
        pairs = [(m, r) for m, r in zip(messages, results, strict=True) if not r.is_later]
        unknown = {m.node for m, r in pairs if r.result == "unknown_node"}
        pairs = [(m, r) for m, r in pairs if m.node not in unknown]
        undescribed = [(m, r) for m, r in pairs if r.result == "unknown_layout"]
        pairs = [(m, r) for m, r in pairs if r.result != "unknown_layout"]
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
        if undescribed:
            unknown |= self._describe(undescribed)
        if unknown:
            self._unknown_nodes.register(unknown)

    def _describe(self, undescribed: list[tuple[SpoolMessage, ItemResult]]) -> set[str]:
        """Post the descriptions that messages need; return nodes that the cloud does not know.

        A message that needs a description that the cloud rejects becomes a dead letter.
        """
        wanted = dict.fromkeys((m.node, name) for m, r in undescribed for name in r.want)
        posted = self._unknown_layouts.post(list(wanted))
        dead: dict[SpoolMessage, DeadLetter] = {}
        for message, result in undescribed:
            for name in result.want:
                each = posted.get((message.node, name))
                if each is not None and each.result == "rejected":
                    reason = f"description {name.hex()}: {each.reason or 'no reason given'}"
                    dead[message] = self._dead_letter(message, reason)
        if dead:
            self._spool.settle(list(dead), list(dead.values()))
            self._metrics.cloud_rejected.inc(len(dead))
            letter = next(iter(dead.values()))
            log.warning(
                "cloud rejected a description: node=%s reason=%r", letter.node, letter.reason[:200]
            )
        return {node for (node, _), each in posted.items() if each.result == "unknown_node"}

    def _dead_letter(self, message: SpoolMessage, reason: str) -> DeadLetter:
        return DeadLetter(self._now(), message.node, f"cloud: {reason[:500]}", message.body)

    def note_failure(self, error: Exception) -> None:
        """Note that `forward` failed; what the cloud has is compared again."""
        self._metrics.cloud_failures.inc()
        self._compare_at = 0.0
        if isinstance(error, CloudError):
            self.reachable = False
