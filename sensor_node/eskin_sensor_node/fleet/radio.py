"""One member's connection: paho's client without threads of its own."""

from __future__ import annotations

import logging
import ssl
from typing import TYPE_CHECKING, Any, Final

from paho.mqtt.enums import CallbackAPIVersion

from eskin.errors import EnvelopeError, MessageError
from eskin.runtime.nodelay import send_at_once
from eskin.wire.messages import Acknowledgement, Kind, Position
from eskin.wire.topics import Stream, node_topic
from eskin_sensor_node.fleet.client import BundlingClient
from eskin_sensor_node.link.uplink import STREAMS, publish_size

if TYPE_CHECKING:
    import paho.mqtt.client as mqtt

    from eskin_sensor_node.firmware.chip import StoredMessage
    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.link.keys import NodeKeys
    from eskin_sensor_node.settings import BrokerSection

log = logging.getLogger(__name__)

_MOST_SPANS: Final = 1000
_MOST_COMMANDS: Final = 16
_READS: Final = 32
_HEARD: Final = (Stream.ACKS, Stream.COMMANDS)


class Radio:
    """Seals and sends what the outbox hands over; takes acknowledgements and commands.

    Messages go at QoS 0: a gateway's acknowledgement is the only one that counts, and the outbox
    sends again what stays without.

    Args:
        keys: With which it seals and opens.
        broker: Where to publish.

    Attributes:
        keys: As given.
        spans: What gateways acknowledged since it was last looked at.
        looks: Those words of theirs that told of somebody who looks on.
        time: Latest time of a gateway's clock in them, UTC ns.
        commands: What came for it since, as the cloud signed it.
        fresh: Whether the broker took it and the outbox does not know it yet.
        online: Whether the broker has taken it.
        attempts: To connect, since it last was.
        sent: Bytes of messages, until somebody takes them into account.
        received: Likewise.
    """

    __slots__ = (
        "_client", "_name", "attempts", "commands", "fresh", "keys", "looks", "online", "received",
        "sent", "spans", "time",
    )  # fmt: skip

    def __init__(self, keys: NodeKeys, broker: BrokerSection) -> None:
        self.keys = keys
        self._name = keys.own.name
        self.spans: list[tuple[int, int, int]] = []
        self.looks: list[Acknowledgement] = []
        self.time: int | None = None
        self.commands: list[bytes] = []
        self.fresh = self.online = False
        self.attempts = self.sent = self.received = 0
        self._client = BundlingClient(
            CallbackAPIVersion.VERSION2, client_id=self._name, clean_session=True, userdata=self
        )
        self._client.tls_set_context(keys.context)
        self._client.max_queued_messages_set(4 * broker.window)
        self._client.on_socket_open = send_at_once
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
        """Connect; blocks up to the handshake's end. For a thread, while nobody else uses it.

        Raises:
            OSError: It cannot be done now.
        """
        self.online = False
        self._client.reconnect()

    def serve(self, *, readable: bool) -> bool:
        """Read and write what goes without blocking; tells whether the connection stands."""
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
        """Ping where it is time; tells whether the connection stands."""
        return not self._client.loop_misc() and self.socket is not None

    def send_due(self, outbox: Outbox, now: int, most: int) -> int:
        """Send what is due; gives how many messages went."""
        due = outbox.due(now, most)
        if not due:
            return 0
        held = Position(*outbox.held())
        newest = outbox.newest_status
        sealed = [self._sealed(kept, held, newest=kept.position == newest) for kept in due]
        self._client.publish_together(sealed)
        for kept in due:
            # At QoS 0 it is gone at once.
            outbox.left(kept.position, now)
        return len(due)

    def close(self) -> None:
        """Say goodbye."""
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

    def greeted(self, client: mqtt.Client, reason: Any) -> None:
        """The broker has answered."""
        if reason.is_failure:
            log.error("broker refuses: node=%s reason=%s", self._name, reason)
            return
        self.attempts = 0
        self.online = self.fresh = True
        # A command that is lost comes late, for it is sent again.
        client.subscribe([(node_topic(self._name, each), 0) for each in _HEARD])

    def heard(self, message: mqtt.MQTTMessage) -> None:
        """Something came."""
        self.received += publish_size(message.topic, message.payload, qos=0)
        if not message.payload:  # the broker forgets what it has kept
            return
        try:
            opened = self.keys.opener.open(bytes(message.payload), topic=message.topic).plaintext
            if message.topic.endswith(Stream.COMMANDS):
                if len(self.commands) < _MOST_COMMANDS:
                    self.commands.append(opened)
            elif len(self.spans) < _MOST_SPANS:
                said = Acknowledgement.decode(opened)
                self.spans.extend(said.spans)
                self.time = said.time if self.time is None else max(self.time, said.time)
                if said.watched:
                    self.looks.append(said)
        except (EnvelopeError, MessageError) as error:
            log.warning("message rejected: topic=%s reason=%s", message.topic, error)


def _on_connect(client: mqtt.Client, radio: Radio, _flags: Any, reason: Any, _: Any) -> None:
    radio.greeted(client, reason)


def _on_message(_client: mqtt.Client, radio: Radio, message: mqtt.MQTTMessage) -> None:
    radio.heard(message)
