"""Publishes commands, sealed for their nodes, until they are answered."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from eskin.wire.messages import Result
from eskin.wire.topics import Stream, node_topic

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from eskin.wire.messages import Summary
    from eskin_gateway.commands.pending import PendingCommands
    from eskin_gateway.metrics import Metrics
    from eskin_gateway.mqtt.sealer_cache import SealerCache
    from eskin_gateway.mqtt.transport import Transport
    from eskin_gateway.spool.node_certificates import NodeCertificates


class CommandPublisher:
    """Publishes pending commands. Not thread-safe.

    A command is retained, so that a node which wakes for a moment finds it at once. It is published
    again until it is answered, because a broker may lose retained messages.

    Args:
        commands: The pending commands.
        broker: The connection to the MQTT broker.
        sealer_cache: Seals commands.
        node_certificates: Finds the nodes' certificates.
        metrics: Counts commands.
        clock: Monotonic seconds.
    """

    def __init__(
        self,
        commands: PendingCommands,
        *,
        broker: Transport,
        sealer_cache: SealerCache,
        node_certificates: NodeCertificates,
        metrics: Metrics,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._commands = commands
        self._broker = broker
        self._sealer_cache = sealer_cache
        self._node_certificates = node_certificates
        self._metrics = metrics
        self._clock = clock

    def note_results(self, messages: Iterable[tuple[str, Summary, bool]]) -> None:
        """Note the results among messages that are durable."""
        for node, message, _ in messages:
            if isinstance(message, Result):
                self._commands.answered(node, message.command)
                self._metrics.command_results.inc()

    def publish_due(self) -> None:
        """Publish commands that are due, and clear those that were withdrawn."""
        if not self._broker.connected:
            return
        now = self._clock()
        for node in self._commands.take_withdrawn():
            self._broker.publish([(node_topic(node, Stream.COMMANDS), b"", True)])
        for node, number, signed in self._commands.due(now):
            latest = self._node_certificates.find_latest(node)
            if latest is None:
                continue  # a node of another site, or one that is not trusted
            to, thumbprint = latest
            topic = node_topic(node, Stream.COMMANDS)
            sealed = self._sealer_cache.seal(signed, topic=topic, to=to, thumbprint=thumbprint)
            self._broker.publish([(topic, sealed, True)])
            self._commands.published(node, number, now)
            self._metrics.commands.inc()
