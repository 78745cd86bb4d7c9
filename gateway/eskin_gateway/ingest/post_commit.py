"""What follows a commit: acknowledgements to nodes, PUBACKs, public messages."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from eskin.errors import UntrustedCertificateError
from eskin.wire.messages import Acknowledgement, BlockSummary, Gap, Peak, Status
from eskin.wire.sequence_set import SequenceRanges
from eskin.wire.topics import Stream, node_topic
from eskin_gateway.publish import public_payloads

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from eskin.wire.messages import Position
    from eskin_gateway.ingest.validator import IngestResult
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.mqtt.sealer_cache import SealerCache
    from eskin_gateway.mqtt.transport import Publication, ReceivedMessage, Transport
    from eskin_gateway.publish.homeassistant import Discovery
    from eskin_gateway.publish.presence import Presence
    from eskin_gateway.spool.node_certificates import NodeCertificates
    from eskin_gateway.upstream.ingest_client import Viewers


class PostCommit:
    """Acknowledges and publishes. Not thread-safe.

    Args:
        broker: The connection to the MQTT broker.
        sealer_cache: Seals acknowledgements.
        node_certificates: Finds the nodes' certificates.
        presence: Tracks which nodes are online.
        metrics: Counts messages.
        viewers: Says how long nodes are viewed.
        discovery: Announces channels to Home Assistant, if enabled.
        senml: Whether blocks are published as SenML, too.
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
        metrics: Metrics,
        viewers: Viewers,
        discovery: Discovery | None = None,
        senml: bool = False,
        clock: Callable[[], float] = time.monotonic,
        now: Callable[[], int] = time.time_ns,
    ) -> None:
        self._broker = broker
        self._sealer_cache = sealer_cache
        self._node_certificates = node_certificates
        self._presence = presence
        self._metrics = metrics
        self._viewers = viewers
        self._discovery = discovery
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
            if self._discovery is not None:
                self._discovery.announce_all()
        self._was_connected = connected
        if connected:
            self._publish(self._presence.expire(now))
            if self._discovery is not None:
                self._publish(self._discovery.run_periodic())

    def _publish(self, publications: Iterable[Publication]) -> None:
        """Publish and count public messages."""
        public = list(publications)
        self._metrics.published.inc(len(public))
        self._broker.publish(public)

    def _acknowledgements(self, result: IngestResult) -> Iterator[Publication]:
        for node, positions in result.positions.items():
            thumbprint = result.batch.nodes[node].thumbprint
            try:
                to = None if thumbprint is None else self._node_certificates.find(thumbprint)
            except UntrustedCertificateError:
                continue  # revoked since it was validated
            if thumbprint is None or to is None:
                continue
            topic = node_topic(node, Stream.ACKS)
            plaintext = Acknowledgement(
                self._now(), _spans(positions), self._viewers.remaining(node)
            ).encode()
            self._metrics.acknowledged.inc(len(positions))
            sealed = self._sealer_cache.seal(plaintext, topic=topic, to=to, thumbprint=thumbprint)
            yield topic, sealed, False

    def _publications(self, result: IngestResult) -> Iterator[Publication]:
        now = self._clock()
        for node, message, live in result.messages:
            public = not isinstance(message, BlockSummary | Peak) or public_payloads.is_public(
                message
            )
            if public and isinstance(message, BlockSummary):
                yield *public_payloads.live(node, message), False
                if self._senml:
                    for topic, pack in public_payloads.live_senml(node, message):
                        yield topic, pack, False
            elif public and isinstance(message, Peak | Gap):
                yield *public_payloads.event(node, message), False
            status = message if isinstance(message, Status) else None
            yield from self._presence.update(node, status, live=live, now=now)
            if status is not None and self._discovery is not None:
                yield from self._discovery.update(node, status)


def _spans(positions: Iterable[Position]) -> tuple[tuple[int, int, int], ...]:
    boots: dict[int, SequenceRanges] = {}
    for position in positions:
        boots.setdefault(position.boot, SequenceRanges()).add(position.sequence)
    return tuple((boot, first, last) for boot in sorted(boots) for first, last in boots[boot])
