"""One member's connection: paho's client without threads of its own."""

from __future__ import annotations

import logging
import ssl
from typing import TYPE_CHECKING, Any, Final

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from eskin.errors import EnvelopeError, MessageError
from eskin.runtime.net import set_nodelay
from eskin.wire.messages import Acknowledgement, Kind, Position
from eskin.wire.topics import Stream, node_topic
from eskin_sensor_node.link.uplink import STREAMS, publish_size

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eskin_sensor_node.firmware.chip import StoredMessage
    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.link.keys import NodeKeys
    from eskin_sensor_node.settings import BrokerSection

log = logging.getLogger(__name__)

_MOST_SPANS: Final = 1000
_MOST_COMMANDS: Final = 16
_READS: Final = 32
_PUBLISH: Final = 0x30
_RETAIN: Final = 0x01
_SUBSCRIBED: Final = (Stream.ACKS, Stream.COMMANDS)


class Connection:
    """Seals and sends messages of the outbox; receives acknowledgements and commands.

    Messages go at QoS 0: only a gateway's acknowledgement counts, and the outbox sends again what
    stays unacknowledged.

    Args:
        keys: With which it seals and opens.
        broker: Where to publish.

    Attributes:
        keys: As given.
        spans: What gateways acknowledged since the last turn.
        time: Latest time of a gateway's clock in them, UTC ns.
        commands: Signed commands that came since.
        descriptions: Hashes of layouts and patches that are to be sent, in order.
        fresh: Whether it is connected and the outbox does not know it yet.
        online: Whether it is connected.
        attempts: To connect, since it last was.
        sent: Bytes of messages since they were last charged.
        received: Likewise.
    """

    __slots__ = (
        "_client", "_introduced", "_name", "attempts", "commands", "descriptions", "fresh", "keys",
        "online", "received", "sent", "spans", "time",
    )  # fmt: skip

    def __init__(self, keys: NodeKeys, broker: BrokerSection) -> None:
        self.keys = keys
        self._name = keys.own.name
        self.spans: list[tuple[int, int, int]] = []
        self.time: int | None = None
        self.commands: list[bytes] = []
        self.descriptions: dict[bytes, None] = {}
        self._introduced = False
        self.fresh = self.online = False
        self.attempts = self.sent = self.received = 0
        self._client = BundlingClient(
            CallbackAPIVersion.VERSION2, client_id=self._name, clean_session=True, userdata=self
        )
        self._client.tls_set_context(keys.context)
        self._client.max_queued_messages_set(4 * broker.window)
        self._client.on_socket_open = set_nodelay
        self._client.on_connect = _on_connect
        self._client.on_message = _on_message
        self._client.connect_async(broker.host, broker.port, keepalive=broker.keepalive_s)

    @property
    def socket(self) -> ssl.SSLSocket | None:
        """What to wait for; ``None`` without a connection."""
        own = self._client.socket()
        return own if isinstance(own, ssl.SSLSocket) else None

    @property
    def writes(self) -> bool:
        """Whether something is to be written."""
        return bool(self._client.want_write())

    def connect(self) -> None:
        """Connect; blocks up to the handshake's end. For the connector's thread.

        Raises:
            OSError: It cannot be done now.
        """
        self.online = False
        self._client.reconnect()

    def serve(self, *, readable: bool) -> bool:
        """Read and write without blocking; returns whether the connection stands."""
        for _ in range(_READS if readable else 0):
            if self._client.loop_read():
                return False
            own = self.socket
            if own is None:
                return False
            if not own.pending():
                break
        if self.writes and self._client.loop_write():
            return False
        return self.socket is not None

    def keep_alive(self) -> bool:
        """Ping when it is time; returns whether the connection stands."""
        return not self._client.loop_misc() and self.socket is not None

    def send_due(self, outbox: Outbox, now: int, most: int) -> int:
        """Send what is due; gives how many messages went."""
        held = Position(*outbox.held())
        # With a status a gateway knows the node, with descriptions it can read frames.
        due = outbox.due(now, 1 if self.descriptions and not self._introduced else most)
        newest = outbox.newest_status
        sealed = [self._sealed(kept, held, newest=kept.position == newest) for kept in due]
        self._introduced = self._introduced or bool(due)
        if self._introduced:
            sealed += self._described(outbox, held)
        self._client.publish_together(sealed)
        for kept in due:
            # At QoS 0 it is gone at once.
            outbox.mark_sent(kept.position, now)
        return len(due)

    def _described(self, outbox: Outbox, held: Position) -> list[tuple[str, bytes, bool]]:
        """Topic and envelope of each description that is to be sent."""
        topic, found = node_topic(self._name, Stream.LAYOUTS), []
        for name in self.descriptions:
            body = outbox.description(name)
            if body is None:
                log.warning("description not sent, unknown: hash=%s", name.hex())
                continue
            envelope = self.keys.sealer.seal(body, topic=topic, held=held)
            self.sent += publish_size(topic, envelope, qos=0)
            found.append((topic, envelope, False))
        self.descriptions = {}
        return found

    def close(self) -> None:
        """Disconnect."""
        self._client.disconnect()
        if self.writes:
            self._client.loop_write()

    def _sealed(
        self, kept: StoredMessage, held: Position, *, newest: bool
    ) -> tuple[str, bytes, bool]:
        """Topic, envelope, and whether the broker keeps it."""
        topic = node_topic(self._name, STREAMS[Kind(kept.kind)])
        status = kept.kind == Kind.STATUS
        envelope = self.keys.sealer.seal(kept.body, topic=topic, held=held, introduce=status)
        self.sent += publish_size(topic, envelope, qos=0)
        return topic, envelope, status and newest

    def on_connect(self, client: mqtt.Client, reason: Any) -> None:
        """Handle the broker's CONNACK."""
        if reason.is_failure:
            log.error("connection refused: node=%s reason=%s", self._name, reason)
            return
        self.attempts = 0
        self.online = self.fresh = True
        self._introduced = False
        # The gateway repeats a command that is lost.
        client.subscribe([(node_topic(self._name, each), 0) for each in _SUBSCRIBED])

    def on_message(self, message: mqtt.MQTTMessage) -> None:
        """Handle a message."""
        self.received += publish_size(message.topic, message.payload, qos=0)
        if not message.payload:  # the broker forgets what it has kept
            return
        try:
            opened = self.keys.opener.open(bytes(message.payload), topic=message.topic).plaintext
            if message.topic.endswith(Stream.COMMANDS):
                if len(self.commands) < _MOST_COMMANDS:
                    self.commands.append(opened)
            elif len(self.spans) < _MOST_SPANS:
                received = Acknowledgement.decode(opened)
                self.spans.extend(received.spans)
                time = received.time
                self.time = time if self.time is None else max(self.time, time)
                self.descriptions |= dict.fromkeys(received.want)
        except (EnvelopeError, MessageError) as error:
            log.warning("message rejected: topic=%s reason=%s", message.topic, error)


def _on_connect(
    client: mqtt.Client, connection: Connection, _flags: Any, reason: Any, _: Any
) -> None:
    connection.on_connect(client, reason)


def _on_message(_client: mqtt.Client, connection: Connection, message: mqtt.MQTTMessage) -> None:
    connection.on_message(message)


class BundlingClient(mqtt.Client):
    """Each write to a TLS connection is a record of its own, and a call of the system."""

    def publish_together(self, messages: Iterable[tuple[str, bytes, bool]]) -> None:
        """Publish messages at QoS 0 in one write, as far as the connection takes it.

        Args:
            messages: Of each its topic, its payload, and whether the broker keeps it.
        """
        packets = b"".join(publish_packet(*message) for message in messages)
        if packets:
            self._packet_queue(mqtt.PUBLISH, packets, 0, 0, mqtt.MQTTMessageInfo(0))


def publish_packet(topic: str, payload: bytes, retained: bool = False) -> bytes:  # noqa: FBT001, FBT002 - the header's bit
    """MQTT's PUBLISH at QoS 0 (MQTT 3.1.1, section 3.3)."""
    name = topic.encode()
    left = 2 + len(name) + len(payload)
    head = bytearray([_PUBLISH | _RETAIN if retained else _PUBLISH])
    while True:
        left, digit = left >> 7, left & 0x7F
        head.append(digit | 0x80 if left else digit)
        if not left:
            break
    return b"".join((head, len(name).to_bytes(2), name, payload))
