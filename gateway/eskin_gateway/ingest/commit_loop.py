"""The thread between receive queue and spool: validate, commit, then acknowledge and publish."""

from __future__ import annotations

import logging
import time
from random import SystemRandom
from typing import TYPE_CHECKING, Final

from eskin.errors import SpoolError, UntrustedCertificateError
from eskin.runtime.supervised import Backoff, Supervised
from eskin.wire.frames import DescribedLayout, EncodedFrame, Privacy, Statements
from eskin.wire.messages import Acknowledgement, Status
from eskin.wire.messages.acknowledgement import MOST_WANTED
from eskin.wire.sequence_set import SequenceRanges
from eskin.wire.topics import Stream, node_topic
from eskin_gateway.metrics import RejectReason
from eskin_gateway.publish import public_payloads
from eskin_gateway.publish.frame_hulls import HullCollector

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from eskin.wire.messages import Position
    from eskin_gateway.commands.publisher import CommandPublisher
    from eskin_gateway.ingest.validator import Described, IngestResult, Validator
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.mqtt.receive_queue import ReceiveQueue
    from eskin_gateway.mqtt.sealer_cache import SealerCache
    from eskin_gateway.mqtt.transport import Publication, ReceivedMessage, Transport
    from eskin_gateway.publish.alarms import AlarmPublisher
    from eskin_gateway.publish.frame_hulls import PublishedHull
    from eskin_gateway.publish.homeassistant import Discovery
    from eskin_gateway.publish.presence import Presence
    from eskin_gateway.settings import SpoolSection
    from eskin_gateway.spool.batch import Batch
    from eskin_gateway.spool.descriptions import Descriptions
    from eskin_gateway.spool.node_certificates import NodeCertificates
    from eskin_gateway.spool.spool import Spool


log = logging.getLogger(__name__)

_TICK_S: Final = 0.25
_RETRY_S: Final = 0.25
_PERIODIC_S: Final = 1.0
_MIN_GROUP: Final = 4
"""Expected messages for which a commit waits."""


class PostCommit:
    """Acknowledges and publishes. Not thread-safe.

    Args:
        broker: The connection to the MQTT broker.
        sealer_cache: Seals acknowledgements.
        node_certificates: Finds the nodes' certificates.
        presence: Tracks which nodes are online.
        alarms: Changes of alarms that are published.
        metrics: Counts messages.
        discovery: Announces channels to Home Assistant, if enabled.
        descriptions: Finds the layouts of frames and statements.
        senml: Whether hulls are published as SenML, too.
        clock: Monotonic seconds.
        now: UTC ns.
    """

    def __init__(  # noqa: PLR0913 - all that is published
        self,
        *,
        broker: Transport,
        sealer_cache: SealerCache,
        node_certificates: NodeCertificates,
        presence: Presence,
        alarms: AlarmPublisher,
        descriptions: Descriptions,
        metrics: Metrics,
        discovery: Discovery | None = None,
        senml: bool = False,
        clock: Callable[[], float] = time.monotonic,
        now: Callable[[], int] = time.time_ns,
    ) -> None:
        self._broker = broker
        self._sealer_cache = sealer_cache
        self._node_certificates = node_certificates
        self._presence = presence
        self._alarms = alarms
        self._metrics = metrics
        self._discovery = discovery
        self._descriptions = descriptions
        self._frame_hulls = HullCollector()
        self._senml = senml
        self._clock = clock
        self._now = now
        self._was_connected = False

    def run(self, result: IngestResult, received_messages: Sequence[ReceivedMessage]) -> None:
        """Acknowledge and publish a batch that is durable."""
        self._broker.publish(self._acknowledgements(result))
        self._broker.acknowledge(received_messages)
        self._publish(self._publications(result))

    def release(self, received_messages: Sequence[ReceivedMessage]) -> None:
        """Send PUBACKs for messages that are not acknowledged to their nodes."""
        self._broker.acknowledge(received_messages)

    def run_periodic(self) -> None:
        """Publish nodes that went offline, and update discovery."""
        now = self._clock()
        connected = self._broker.connected
        if connected and not self._was_connected:
            self._presence.restart_timers(now)
            self._alarms.restart()
            if self._discovery is not None:
                self._discovery.announce_all()
        self._was_connected = connected
        if connected:
            self._publish(self._hulls(self._frame_hulls.run_periodic(now)))
            self._publish(self._presence.expire(now))
            if self._discovery is not None:
                self._publish(self._discovery.run_periodic())

    def publish_alarms(self) -> None:
        """Publish changes of alarms that are due."""
        if self._was_connected and self._broker.connected:
            self._publish(self._alarms.due(self._clock()))

    def _publish(self, publications: Iterable[Publication]) -> None:
        """Publish and count public messages."""
        public = list(publications)
        self._metrics.published.inc(len(public))
        self._broker.publish(public)

    def _acknowledgements(self, result: IngestResult) -> Iterator[Publication]:
        for node in dict.fromkeys([*result.positions, *result.want]):
            positions = result.positions.get(node, [])
            thumbprint = result.batch.nodes[node].thumbprint
            try:
                to = None if thumbprint is None else self._node_certificates.find(thumbprint)
            except UntrustedCertificateError:
                continue  # revoked since it was validated
            if thumbprint is None or to is None:
                continue
            topic = node_topic(node, Stream.ACKS)
            plaintext = Acknowledgement(
                self._now(),
                _spans(positions),
                tuple(result.want.get(node, ()))[:MOST_WANTED],
            ).encode()
            self._metrics.acknowledged.inc(len(positions))
            sealed = self._sealer_cache.seal(plaintext, topic=topic, to=to, thumbprint=thumbprint)
            yield topic, sealed, False

    def _publications(self, result: IngestResult) -> Iterator[Publication]:
        now = self._clock()
        for node, message, live in result.messages:
            if isinstance(message, EncodedFrame | Statements):
                yield from self._described(node, message, now)
            status = message if isinstance(message, Status) else None
            yield from self._presence.update(node, status, live=live, now=now)
            if status is not None and self._discovery is not None:
                yield from self._discovery.update(node, status)
        yield from self._hulls(self._frame_hulls.run_periodic(now))

    def _hulls(self, due: Iterable[tuple[str, PublishedHull]]) -> Iterator[Publication]:
        for node, hull in due:
            yield from public_payloads.hulls(node, hull, senml=self._senml)

    def _described(self, node: str, message: Described, now: float) -> Iterator[Publication]:
        skin = self._descriptions.find(node, message.layout)
        if not isinstance(skin, DescribedLayout):  # damaged since it was validated
            return
        if isinstance(message, Statements):
            if skin.require_statements(message) is Privacy.BIOMETRIC:
                return
            yield from public_payloads.statements(node, message, skin)
        elif message.page in skin.biometric_pages:
            return
        else:
            yield from self._hulls(self._frame_hulls.add(node, message, skin, now=now))
        if self._discovery is not None:
            yield from self._discovery.describe(node, skin)


def _spans(positions: Iterable[Position]) -> tuple[tuple[int, int, int], ...]:
    boots: dict[int, SequenceRanges] = {}
    for position in positions:
        boots.setdefault(position.boot, SequenceRanges()).add(position.sequence)
    return tuple((boot, first, last) for boot in sorted(boots) for first, last in boots[boot])


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
        wait: Waits so many seconds before a failed commit is tried again; returns whether to give
            up. By default it gives up when the loop is stopped.

    Attributes:
        fault: Why nothing can be committed.
    """

    def __init__(  # noqa: PLR0913 - all that a batch passes, and what runs it
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
        wait: Callable[[float], bool] | None = None,
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
        self._wait = wait or self._thread.stopping.wait

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
        self._post_commit.publish_alarms()
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
        if (batch.nodes or batch.certificates or batch.descriptions) and not self._commit(batch):
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
                if self._wait(_RETRY_S):
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
        self._metrics.waiting.inc(result.waiting)
        for reason, count in result.rejected.items():
            self._metrics.rejected(reason, count)
