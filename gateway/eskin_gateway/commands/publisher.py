"""Publishes commands, sealed for their nodes, until they are answered."""

from __future__ import annotations

import time
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING

from eskin.wire.messages import Result
from eskin.wire.topics import Stream, node_topic

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from eskin_gateway.metrics import Metrics
    from eskin_gateway.mqtt.sealer_cache import SealerCache
    from eskin_gateway.mqtt.transport import Transport
    from eskin_gateway.spool.node_certificates import NodeCertificates


@dataclass(slots=True)
class _Command:
    id: int
    signed: bytes
    published: float | None = None
    answered: bool = False


class PendingCommands:
    """Commands that the cloud wants delivered, at most one for each node.

    Shared by the thread that fetches commands and the one that publishes them.

    Nothing of it is durable: after a restart the cloud sends all of it again.

    Args:
        resend_s: Seconds after which a command is published again.
    """

    def __init__(self, resend_s: float) -> None:
        self._resend_s = resend_s
        self._lock = Lock()
        self._commands: dict[str, _Command] = {}
        self._withdrawn: set[str] = set()

    def change(
        self, give: Iterable[tuple[str, int, bytes]], drop: Iterable[tuple[str, int]]
    ) -> None:
        """Apply changes of the cloud."""
        with self._lock:
            for node, number in drop:
                command = self._commands.get(node)
                if command is not None and command.id == number:
                    del self._commands[node]
                    self._withdrawn.add(node)
            for node, number, signed in give:
                self._commands[node] = _Command(number, signed)

    def pending(self) -> list[tuple[str, int, bool]]:
        """Node, id, and whether it was published."""
        with self._lock:
            return [(n, c.id, c.published is not None) for n, c in self._commands.items()]

    def due(self, now: float) -> list[tuple[str, int, bytes]]:
        """Node, id and bytes of commands to publish now.

        Args:
            now: Monotonic seconds.
        """
        with self._lock:
            return [
                (node, command.id, command.signed)
                for node, command in self._commands.items()
                if not command.answered
                and (command.published is None or now >= command.published + self._resend_s)
            ]

    def published(self, node: str, number: int, now: float) -> None:
        """Note that a command was published."""
        with self._lock:
            command = self._commands.get(node)
            if command is not None and command.id == number:
                command.published = now
            self._withdrawn.discard(node)

    def answered(self, node: str, number: int) -> None:
        """Note the result of a command, which also ends all earlier ones."""
        with self._lock:
            command = self._commands.get(node)
            if command is not None and command.id <= number and not command.answered:
                command.answered = True
                self._withdrawn.add(node)

    def take_withdrawn(self) -> list[str]:
        """Nodes whose retained command must be cleared, each once."""
        with self._lock:
            nodes, self._withdrawn = sorted(self._withdrawn), set()
            return nodes


class CommandPublisher:
    """Publishes pending commands. Not thread-safe.

    A command is retained, so that a node which wakes briefly finds it at once. It is published
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

    def note_results(self, messages: Iterable[tuple[str, object, bool]]) -> None:
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
