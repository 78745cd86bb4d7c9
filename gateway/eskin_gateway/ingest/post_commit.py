"""What the gateway says once a batch is durable: to nodes, to the broker, to the public."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from eskin.errors import UntrustedCertificateError
from eskin.wire.messages import BlockSummary, Gap, Peak, Status
from eskin_gateway.publish import public_payloads

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from eskin_gateway.ingest.acknowledger import Acknowledger
    from eskin_gateway.ingest.validator import IngestResult
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.mqtt.received_message import ReceivedMessage
    from eskin_gateway.mqtt.transport import Publication, Transport
    from eskin_gateway.publish.discovery import Discovery
    from eskin_gateway.publish.presence import Presence
    from eskin_gateway.spool.node_certificates import NodeCertificates
    from eskin_gateway.upstream.viewers import Viewers


class PostCommit:
    """Acknowledges and publishes. Only for one thread.

    Args:
        broker: Takes it all.
        acknowledger: Seals the word to nodes.
        node_certificates: Knows their certificates.
        presence: Knows who is there.
        metrics: What is counted.
        viewers: Know who is watched.
        discovery: Announces channels; ``None`` where nobody looks for them.
        senml: Whether hulls are published as SenML, too.
        clock: Monotonic seconds.
        now: UTC ns.
    """

    def __init__(  # noqa: PLR0913 - all that answers go to
        self,
        *,
        broker: Transport,
        acknowledger: Acknowledger,
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
        self._acknowledger = acknowledger
        self._node_certificates = node_certificates
        self._presence = presence
        self._metrics = metrics
        self._viewers = viewers
        self._discovery = discovery
        self._senml = senml
        self._clock = clock
        self._now = now
        self._heard_all = False

    def give(self, outcome: IngestResult, received_messages: Sequence[ReceivedMessage]) -> None:
        """Answer for a batch that is durable."""
        self._broker.publish(self._acknowledgements(outcome))
        self._broker.acknowledge(received_messages)
        self._tell(self._publications(outcome))

    def release(self, received_messages: Sequence[ReceivedMessage]) -> None:
        """Let the broker forget messages that are not acknowledged to their nodes."""
        self._broker.acknowledge(received_messages)

    def idle(self) -> None:
        """Time to notice who is silent, and who is gone."""
        now = self._clock()
        if not self._broker.connected:
            self._heard_all = False
            return
        if not self._heard_all:
            self._heard_all = True
            self._presence.excuse(now)
            if self._discovery is not None:
                self._discovery.renew()
        self._tell(self._presence.silent(now))
        if self._discovery is not None:
            self._tell(self._discovery.idle())

    def _tell(self, publications: Iterable[Publication]) -> None:
        """Hand public messages to the broker."""
        told = list(publications)
        self._metrics.published.inc(len(told))
        self._broker.publish(told)

    def _acknowledgements(self, outcome: IngestResult) -> Iterator[tuple[str, bytes, bool]]:
        now = self._now()
        for node, positions in outcome.positions.items():
            named = outcome.batch.nodes[node].thumbprint
            try:
                certificate = None if named is None else self._node_certificates.find(named)
            except UntrustedCertificateError:
                continue  # revoked this very moment: no answer is owed
            if named is None or certificate is None:
                continue
            topic, sealed = self._acknowledger.seal(
                node,
                positions,
                to=certificate,
                named=named,
                time=now,
                watched=self._viewers.remaining(node),
            )
            self._metrics.acknowledged.inc(len(positions))
            yield topic, sealed, False

    def _publications(self, outcome: IngestResult) -> Iterator[tuple[str, bytes, bool]]:
        now = self._clock()
        for node, message, live in outcome.messages:
            shown = not isinstance(message, BlockSummary | Peak) or public_payloads.is_public(
                message
            )
            if shown and isinstance(message, BlockSummary):
                yield *public_payloads.live(node, message), False
                if self._senml:
                    for topic, pack in public_payloads.live_senml(node, message):
                        yield topic, pack, False
            elif shown and isinstance(message, Peak | Gap):
                yield *public_payloads.event(node, message), False
            status = message if isinstance(message, Status) else None
            yield from self._presence.heard(node, status, live=live, now=now)
            if status is not None and self._discovery is not None:
                yield from self._discovery.heard(node, status)
