"""The broker: takes what nodes publish to one of the gateways, and acknowledgements back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.wire.topics import Stream, node_topic

if TYPE_CHECKING:
    from tests.robustness.simulation.gateway import Gateway
    from tests.robustness.simulation.world import World


class Broker:
    """Gives each message to the next gateway that is connected, and keeps each node's status.

    Args:
        world: What it is part of.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._latency = world.timeline.draws("latency of the broker")
        self._retained: dict[str, tuple[str, int, bytes]] = {}
        self._next = 0

    def take(self, node: str, number: int, topic: str, payload: bytes, *, retain: bool) -> None:
        """Take a message of a node."""
        if retain:
            self._retained[topic] = node, number, payload
        connected = [each for each in self._world.gateways if each.connected]
        if not connected:
            self._world.timeline.note("broker", f"has no gateway for {node}#{number}")
            return
        self._next += 1
        chosen = connected[self._next % len(connected)]
        copies = 2 if self._world.faults.often(chosen.name, "gets messages twice") else 1
        for _ in range(copies):
            self._deliver(chosen, node, number, topic, payload, retained=False)

    def connect(self, gateway: Gateway) -> None:
        """Give a gateway that connects the nodes' latest status."""
        for topic, (node, number, payload) in self._retained.items():
            self._deliver(gateway, node, number, topic, payload, retained=True)

    def _deliver(
        self,
        gateway: Gateway,
        node: str,
        number: int,
        topic: str,
        payload: bytes,
        *,
        retained: bool,
    ) -> None:
        delay = self._latency.uniform(0.001, 0.02)
        if self._world.faults.often(gateway.name, "gets messages late"):
            delay += self._latency.uniform(0.0, 6.0)
        life = gateway.life

        def arrive() -> None:
            if gateway.life == life:
                gateway.receive(f"{node}#{number}", topic, payload, retained=retained)

        self._world.timeline.after(delay, arrive)

    def acknowledge(self, node: str, payload: bytes) -> None:
        """Give a node an acknowledgement."""
        topic = node_topic(node, Stream.ACKS)
        delay = self._latency.uniform(0.001, 0.05)
        self._world.timeline.after(delay, lambda: self._world.node(node).receive(topic, payload))
