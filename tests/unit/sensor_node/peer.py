"""The other end: a tiny gateway that opens what a node says, and acknowledges it when stated to."""

from __future__ import annotations

import threading
import time
from collections import Counter
from typing import TYPE_CHECKING, Any, Self

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from eskin.errors import UnknownSenderError
from eskin.identity import ChainVerifier, client_context, thumbprint
from eskin.identity.identity_kind import IdentityKind
from eskin.wire.envelope import Opener, Sealer, introduction
from eskin.wire.frames import content_hash
from eskin.wire.messages import Acknowledgement
from eskin.wire.topics import Stream, node_topic
from tests.unit.sensor_node.messages import decode

if TYPE_CHECKING:
    from cryptography import x509

    from eskin.wire.frames import Frame, Statements
    from eskin.wire.messages import Message, Position
    from tests.support.identities import Identities


class Peer:
    """A gateway without a spool.

    Attributes:
        acknowledging: Whether it answers.
        order: Positions in order of their first arrival.
        timeline: Names of descriptions and positions of messages, each as often as it came.
        held: The last that the node said it still holds.
        unintroduced: Messages that came before their sender's introduction.
    """

    def __init__(self, identities: Identities, port: int, *, acknowledging: bool = True) -> None:
        self.acknowledging = acknowledging
        self._messages: dict[Position, Message | Frame | Statements] = {}
        self._copies: Counter[Position] = Counter()
        self.order: list[Position] = []
        self.timeline: list[bytes | Position] = []
        self.held: Position | None = None
        self._retained: Counter[str] = Counter()
        self.unintroduced = 0
        self._identities = identities
        self._trust = ChainVerifier(*identities.authority.roots)
        self._known: dict[bytes, x509.Certificate] = {}
        self._opener = Opener([identities.site], sender=self._known.get)
        self._sealers: dict[str, Sealer] = {}
        self._subscribed = threading.Event()
        own = identities.gateway
        self.client = mqtt.Client(CallbackAPIVersion.VERSION2, client_id=own.name)
        self.client.tls_set_context(client_context(own.directory / "root.pem", own))
        self.client.on_connect = self._on_connect
        self.client.on_subscribe = lambda *_: self._subscribed.set()
        self.client.on_message = self._on_message
        self._port = port

    def __enter__(self) -> Self:
        self.client.connect("127.0.0.1", self._port)
        self.client.loop_start()
        assert self._subscribed.wait(60)
        return self

    def __exit__(self, *_: object) -> None:
        self.client.disconnect()
        self.client.loop_stop()

    @property
    def messages(self) -> dict[Position, Message | Frame | Statements]:
        """What it has opened by now, by position; a copy, as more may come meanwhile."""
        return self._messages.copy()

    @property
    def copies(self) -> Counter[Position]:
        """How often each came by now."""
        return self._copies.copy()

    @property
    def retained(self) -> Counter[str]:
        """Retained messages that waited for it, by topic."""
        return self._retained.copy()

    def acknowledge(
        self,
        node: str,
        positions: list[Position],
        *,
        topic: str = "",
        time_ns: int | None = None,
        want: tuple[bytes, ...] = (),
    ) -> None:
        """Acknowledge messages, by a clock that says ``time_ns``.

        ``want``: descriptions that it lacks.
        """
        spans = tuple((p.boot, p.sequence, p.sequence) for p in positions)
        topic = topic or node_topic(node, Stream.ACKS)
        sealed = self._sealers[node].seal(
            Acknowledgement(time_ns or time.time_ns(), spans, want=want).encode(),
            topic=topic,
        )
        self.client.publish(node_topic(node, Stream.ACKS), sealed, qos=1)

    def _on_connect(self, client: mqtt.Client, *_: Any) -> None:
        streams = (Stream.FRAMES, Stream.LAYOUTS, Stream.EVENTS, Stream.STATUS)
        client.subscribe([(node_topic("+", stream), 1) for stream in streams])

    def _on_message(self, _client: mqtt.Client, _data: Any, message: mqtt.MQTTMessage) -> None:
        envelope = bytes(message.payload)
        if message.retain:
            self._retained[message.topic] += 1
        chain = introduction(envelope)
        if chain is not None:
            leaf = self._trust.verify(chain, IdentityKind.NODE)
            self._known[thumbprint(leaf)] = leaf
        try:
            opened = self._opener.open(envelope, topic=message.topic)
        except UnknownSenderError:
            self.unintroduced += 1
            return
        if opened.sender not in self._sealers:
            node = next(c for c in self._known.values() if opened.sender in str(c.subject))
            self._sealers[opened.sender] = Sealer(self._identities.site, node)
        if message.topic.endswith(Stream.LAYOUTS):
            self.timeline.append(content_hash(opened.plaintext))
            return
        said = decode(opened.plaintext)
        self.timeline.append(said.position)
        self.held = opened.held
        if said.position not in self._messages:
            self.order.append(said.position)
        self._messages[said.position] = said
        self._copies[said.position] += 1
        if self.acknowledging:
            self.acknowledge(opened.sender, [said.position])
