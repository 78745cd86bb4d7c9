"""Publishes commands, sealed for their nodes, until they are answered."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from eskin.errors import UntrustedCertificateError
from eskin.wire.messages import Result
from eskin.wire.topics import Stream, node_topic

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from cryptography import x509

    from eskin.wire.messages import Summary
    from eskin_gateway.commands.pending import PendingCommands
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.mqtt.transport import Transport
    from eskin_gateway.spool.node_certificates import NodeCertificates
    from eskin_gateway.spool.sealer_cache import SealerCache
    from eskin_gateway.spool.spool import Spool


class CommandPublisher:
    """Hands commands to the broker. Only for one thread.

    The broker keeps a node's command (retain), so that a node which wakes for a moment only finds
    it at once; and it is published again until it is answered, as a broker may forget.

    Args:
        commands: What should be delivered.
        broker: Takes it.
        sealer_cache: Seal for nodes.
        node_certificates: Know the nodes' certificates.
        spool: Remembers which certificate a node used last.
        metrics: What is counted.
        clock: Monotonic seconds.
    """

    def __init__(
        self,
        commands: PendingCommands,
        *,
        broker: Transport,
        sealer_cache: SealerCache,
        node_certificates: NodeCertificates,
        spool: Spool,
        metrics: Metrics,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._commands = commands
        self._broker = broker
        self._sealer_cache = sealer_cache
        self._node_certificates = node_certificates
        self._spool = spool
        self._metrics = metrics
        self._clock = clock

    def note(self, messages: Iterable[tuple[str, Summary, bool]]) -> None:
        """Take notice of answers that are durable."""
        for node, message, _ in messages:
            if isinstance(message, Result):
                self._commands.answered(node, message.command)
                self._metrics.answers.inc()

    def dispatch(self) -> None:
        """Publish what is due, and have the broker forget what was answered."""
        if not self._broker.connected:
            return
        now = self._clock()
        for node in self._commands.withdrawn():
            self._broker.publish([(node_topic(node, Stream.COMMANDS), b"", True)])
        for node, number, signed in self._commands.due(now):
            found = self._certificate(node)
            if found is None:
                continue  # a node of another site, or one that is not trusted any more
            certificate, named = found
            topic = node_topic(node, Stream.COMMANDS)
            sealed = self._sealer_cache.seal(signed, topic=topic, to=certificate, named=named)
            self._broker.publish([(topic, sealed, True)])
            self._commands.sent(node, number, now)
            self._metrics.commands.inc()

    def _certificate(self, node: str) -> tuple[x509.Certificate, bytes] | None:
        record = self._spool.node(node)
        if record is None or record.thumbprint is None:
            return None
        self._node_certificates.refresh()
        try:
            certificate = self._node_certificates.find(record.thumbprint)
        except UntrustedCertificateError:
            return None
        return None if certificate is None else (certificate, record.thumbprint)
