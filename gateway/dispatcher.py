"""Publishes commands, sealed for their nodes, until they are answered."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from eskin.errors import UntrustedCertificateError
from eskin.messages import Result
from eskin.topics import Stream, node_topic

if TYPE_CHECKING:
    from collections.abc import Callable

    from cryptography import x509

    from gateway.broker import Broker
    from gateway.commands import Commands
    from gateway.counters import Counters
    from gateway.intake import Outcome
    from gateway.sealers import Sealers
    from gateway.senders import Senders
    from gateway.spool import Spool


class Dispatcher:
    """Hands commands to the broker. Only for one thread.

    The broker keeps a node's command (retain), so that a node which wakes for a moment only finds
    it at once; and it is published again until it is answered, as a broker may forget.

    Args:
        commands: What should be delivered.
        broker: Takes it.
        sealers: Seal for nodes.
        senders: Know the nodes' certificates.
        spool: Remembers which certificate a node used last.
        counters: What is counted.
        clock: Monotonic seconds.
    """

    def __init__(
        self,
        commands: Commands,
        *,
        broker: Broker,
        sealers: Sealers,
        senders: Senders,
        spool: Spool,
        counters: Counters,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._commands = commands
        self._broker = broker
        self._sealers = sealers
        self._senders = senders
        self._spool = spool
        self._counters = counters
        self._clock = clock

    def note(self, outcome: Outcome) -> None:
        """Take notice of answers that are durable."""
        for node, message, _ in outcome.messages:
            if isinstance(message, Result):
                self._commands.answered(node, message.command)
                self._counters.answers.inc()

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
            sealed = self._sealers.seal(signed, topic=topic, to=certificate, named=named)
            self._broker.publish([(topic, sealed, True)])
            self._commands.sent(node, number, now)
            self._counters.commands.inc()

    def _certificate(self, node: str) -> tuple[x509.Certificate, bytes] | None:
        record = self._spool.node(node)
        if record is None or record.thumbprint is None:
            return None
        self._senders.refresh()
        try:
            certificate = self._senders.find(record.thumbprint)
        except UntrustedCertificateError:
            return None
        return None if certificate is None else (certificate, record.thumbprint)
