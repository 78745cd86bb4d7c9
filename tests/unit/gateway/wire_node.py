"""A node in tests: seals messages and opens acknowledgements."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from eskin.identity import client_context
from eskin.identity.identity import ROOT_FILE
from eskin.wire.envelope import Opener, Sealer
from eskin.wire.messages import Acknowledgement, Position
from eskin.wire.topics import Stream, live_topic, node_topic
from tests.support.processes import wait_until
from tests.unit.gateway.messages import DESCRIPTIONS

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Any

    from eskin.identity import Identity
    from eskin.wire.frames import Frame, Layout, Patch, Statements
    from eskin.wire.messages import Result, Status

    Sendable = Status | Result | Frame | Statements | Patch | Layout


class WireNode:
    """Over the real broker.

    ``acknowledged`` holds all acknowledged positions, ``wanted`` the hashes that were asked for,
    ``commands`` the decrypted commands and whether they were retained.
    """

    def __init__(self, identity: Identity, site: Identity, port: int) -> None:
        self.name = identity.name
        self.acknowledged: set[tuple[int, int]] = set()
        self.times: list[int] = []
        self.wanted: list[bytes] = []
        self.commands: list[tuple[bytes, bool]] = []
        self.seal = Seal(identity, site)
        self._opener = Opener(
            [identity],
            sender=lambda named: site.certificate if named == site.thumbprint else None,
        )
        self._client = paho.Client(CallbackAPIVersion.VERSION2, client_id=identity.name)
        self._client.tls_set_context(client_context(identity.directory / ROOT_FILE, identity))
        self._client.on_message = self._on_message
        self._client.on_connect = self._on_connect
        self._client.on_disconnect = self._on_disconnect
        self._client.on_subscribe = self._on_subscribe
        self._client.reconnect_delay_set(1, 1)
        self.ready = False
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()

    def __enter__(self) -> Self:
        wait_until(lambda: self.ready, "the test's node is subscribed")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def say(self, stream: Stream, message: Sendable, *, held: Position | None = None) -> bytes:
        """Seal and publish; gives the envelope.

        A status is followed by what describes the fingertip, as at a connection.
        """
        introduce = stream is Stream.STATUS
        envelope = self.seal(self.name, stream, message.encode(), held=held, introduce=introduce)
        self.publish(stream, envelope, retain=introduce)
        if introduce:
            for each in DESCRIPTIONS:
                self.say(Stream.LAYOUTS, each)
        return envelope

    def publish(self, stream: Stream, envelope: bytes, *, retain: bool = False) -> None:
        """Publish bytes as they are."""
        self._said = self._client.publish(
            node_topic(self.name, stream), envelope, qos=1, retain=retain
        )

    def wait_for_broker(self) -> None:
        """Wait until the broker has what was published last, and all before."""
        wait_until(self._said.is_published, "the broker has it")

    def wait_for(self, *positions: tuple[int, int]) -> None:
        """Wait until positions are acknowledged."""
        wait_until(lambda: self.acknowledged.issuperset(positions), f"{positions} are acknowledged")

    def _on_connect(self, client: paho.Client, *_: Any) -> None:
        wanted = (Stream.ACKS, Stream.COMMANDS)
        client.subscribe([(node_topic(self.name, stream), 1) for stream in wanted])

    def _on_subscribe(self, *_: Any) -> None:
        self.ready = True

    def _on_disconnect(self, *_: Any) -> None:
        self.ready = False

    def _on_message(self, client: paho.Client, userdata: Any, message: paho.MQTTMessage) -> None:
        del client, userdata
        if not message.payload:
            return  # the broker forgets a command
        opened = self._opener.open(bytes(message.payload), topic=message.topic)
        if message.topic == node_topic(self.name, Stream.COMMANDS):
            self.commands.append((opened.plaintext, message.retain))
            return
        answer = Acknowledgement.decode(opened.plaintext)
        self.times.append(answer.time)
        self.wanted += answer.want
        for boot, first, last in answer.spans:
            self.acknowledged.update((boot, number) for number in range(first, last + 1))


class Seal:
    """Seals plaintexts of one identity to a site."""

    def __init__(self, identity: Identity, site: Identity) -> None:
        self._sealer = Sealer(identity, site.certificate)

    def __call__(
        self,
        node: str,
        stream: Stream,
        plaintext: bytes,
        *,
        held: Position | None = None,
        introduce: bool = False,
    ) -> bytes:
        topic = node_topic(node, stream)
        return self._sealer.seal(plaintext, topic=topic, held=held, introduce=introduce)


class Listener:
    """A client that reads public topics. ``received`` holds topic, payload and retain flag."""

    def __init__(self, identity: Identity, port: int, topic: str = live_topic("+", "#")) -> None:
        self.received: list[tuple[str, bytes, bool]] = []
        self._client = paho.Client(CallbackAPIVersion.VERSION2, client_id=identity.name)
        self._client.tls_set_context(client_context(identity.directory / ROOT_FILE, identity))
        self._subscribed = False
        self._client.on_message = self._on_message
        self._client.on_subscribe = self._on_subscribe
        self._client.connect("127.0.0.1", port)
        self._client.subscribe(topic, qos=1)
        self._client.loop_start()

    def __enter__(self) -> Self:
        wait_until(lambda: self._subscribed, "the test's listener is subscribed")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def on(self, topic: str) -> list[bytes]:
        """What came on one topic."""
        return [payload for on, payload, _ in list(self.received) if on == topic]

    def _on_subscribe(self, *_: Any) -> None:
        self._subscribed = True

    def _on_message(self, client: paho.Client, userdata: Any, message: paho.MQTTMessage) -> None:
        del client, userdata
        self.received.append((message.topic, bytes(message.payload), message.retain))
