"""The connection to the MQTT broker: paho's client in a thread of the gateway.

paho's own thread wakes for each packet that another thread hands over. This thread sends a whole
batch of PUBACKs and publications at once. It writes these two packets itself (MQTT 3.1.1, sections
3.3 and 3.4; version 5 adds a list of properties, which is empty here); paho writes all others, and
reads all.
"""

from __future__ import annotations

import logging
import select
import socket
import struct
import time
from collections import deque
from contextlib import suppress
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.subscribeoptions import SubscribeOptions

from eskin.runtime.net import set_nodelay
from eskin.runtime.supervised import Supervised
from eskin.wire.envelope import MOST_ENVELOPE
from eskin.wire.topics import ALARMS, Stream, alarm_topic, node_topic
from eskin_gateway.mqtt.buffered_socket import BufferedSocket
from eskin_gateway.mqtt.transport import ReceivedMessage

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable, Iterable, Sequence

    from paho.mqtt.reasoncodes import ReasonCode

    from eskin.runtime.supervised import Backoff
    from eskin_gateway.mqtt.receive_queue import ReceiveQueue
    from eskin_gateway.mqtt.transport import Publication
    from eskin_gateway.settings import BrokerSection

log = logging.getLogger(__name__)

_PUBLISH: Final = 0x30
_PUBACK: Final = struct.Struct(">HH")
_ACKNOWLEDGED: Final = 0x4002
"""Type and remaining length of a PUBACK."""
_PROTOCOLS: Final = {"3.1.1": MQTTProtocolVersion.MQTTv311, "5": MQTTProtocolVersion.MQTTv5}
_TICK_S: Final = 0.5
_READS: Final = 64
_FULL_TICK_S: Final = 0.005
_DISCONNECT_S: Final = 1.0
_ALARMS: Final = f"{ALARMS}/"
_MAX_QUEUED: Final = 20_000
_MAX_QUEUED_BYTES: Final = 33_554_432


def write_publication(topic: str, payload: bytes, *, retain: bool, v5: bool) -> bytes:
    """Write a PUBLISH at QoS 0."""
    header = _variable_header(topic, v5=v5)
    return b"%b%b%b" % (
        _fixed_header(_PUBLISH | retain, len(header) + len(payload)),
        header,
        payload,
    )


@lru_cache(16_384)
def _variable_header(topic: str, *, v5: bool) -> bytes:
    """The variable header: topic and no properties."""
    name = topic.encode()
    return b"%b%b%b" % (len(name).to_bytes(2), name, bytes(v5))


@lru_cache(4096)
def _fixed_header(kind: int, length: int) -> bytes:
    """The fixed header (section 2.2)."""
    header = bytearray((kind,))
    while length > 127:
        header.append(length & 127 | 128)
        length >>= 7
    header.append(length)
    return bytes(header)


def write_acknowledgements(mids: Iterable[int]) -> bytes:
    """Write a PUBACK for each identifier."""
    return b"".join([_PUBACK.pack(_ACKNOWLEDGED, mid) for mid in mids])


class SendQueue:
    """A bounded queue of packets for the broker. One thread puts, one takes.

    PUBACKs are not counted: there are no more than received messages.
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[bytes, int | None]] = deque()
        # Bytes ever put and ever taken. One thread writes each counter.
        self._put = self._taken = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, publication: bytes) -> bool:
        """Add a PUBLISH; return whether there was room."""
        if len(self._waiting) >= _MAX_QUEUED or self._put - self._taken >= _MAX_QUEUED_BYTES:
            return False
        self._put += len(publication)
        self._waiting.append((publication, None))
        return True

    def acknowledge(self, acknowledgements: bytes, *, connection: int) -> None:
        """Add PUBACKs, which are valid on one connection only."""
        self._waiting.append((acknowledgements, connection))

    def take(self, connection: int) -> bytes | None:
        """Take the oldest packet that is valid on a connection, if there is one."""
        while self._waiting:
            packet, bound_to = self._waiting.popleft()
            if bound_to is None:
                self._taken += len(packet)
            # On another connection, the identifier may name another message.
            if bound_to in {None, connection}:
                return packet
        return None


class MqttTransport:
    """A connection to the broker that reconnects after failures.

    Args:
        settings: Address and protocol.
        name: The gateway's name, also its client id.
        context: Presents the gateway's certificate and verifies the broker's.
        receive_queue: Takes received messages.
        on_alarm: Takes topic and payload of each alarm that the broker has.
        backoff: Delays between connection attempts.

    Attributes:
        dropped: Publications that were dropped.
        accepting: Whether received messages are queued.
        connection: Number of connections so far.
    """

    def __init__(
        self,
        settings: BrokerSection,
        *,
        name: str,
        context: ssl.SSLContext,
        receive_queue: ReceiveQueue,
        on_alarm: Callable[[str, bytes], None],
        backoff: Backoff,
    ) -> None:
        self._settings = settings
        self._on_alarm = on_alarm
        self._receive_queue = receive_queue
        self._send_queue = SendQueue()
        self._wake_in, self._wake_out = socket.socketpair()
        for end in (self._wake_in, self._wake_out):
            end.settimeout(0.0)
        self._subscribed = False
        self._full_checked = self._full_since = float("-inf")
        self._had_room = True
        self.dropped = 0
        self.accepting = True
        self.connection = 0
        self._fault: str | None = None
        self._v5 = settings.protocol == "5"
        self._client = self._make_client(name, context)
        self._thread = Supervised("broker", self._connect_and_serve, backoff=backoff)

    def start(self) -> None:
        """Connect, and stay connected, in a thread."""
        self._thread.start()

    def pause(self) -> None:
        """Queue no further messages; publications are still sent."""
        self.accepting = False

    def stop(self) -> None:
        """Send what is queued, disconnect and end the thread."""
        self._thread.stopping.set()
        self._wake()
        self._thread.stop()
        self._wake_in.close()
        self._wake_out.close()

    @property
    def connected(self) -> bool:
        """Whether the broker has granted all subscriptions."""
        return self._subscribed

    @property
    def fault(self) -> str | None:
        """Why there is no connection; ``None`` while connected."""
        if self._subscribed:
            return None
        return self._fault or self._thread.fault or "not connected yet"

    def acknowledge(self, received_messages: Sequence[ReceivedMessage]) -> None:
        """See `Transport.acknowledge`."""
        by_connection: dict[int, list[int]] = {}
        for message in received_messages:
            if message.qos:
                by_connection.setdefault(message.connection, []).append(message.mid)
        for connection, mids in by_connection.items():
            self._send_queue.acknowledge(write_acknowledgements(mids), connection=connection)
        self._wake()

    def publish(self, publications: Iterable[Publication]) -> None:
        """Publish at QoS 0; drop and count while disconnected or while the send queue is full."""
        for topic, payload, retain in publications:
            packet = write_publication(topic, payload, retain=retain, v5=self._v5)
            if not self._subscribed or not self._send_queue.put(packet):
                self.dropped += 1
        self._wake()

    def _make_client(self, name: str, context: ssl.SSLContext) -> _PahoClient:
        v5 = self._v5
        # The context makes the sockets of this connection only.
        context.sslsocket_class = BufferedSocket
        client = _PahoClient(
            receive=self.receive,
            client_id=name,
            clean_session=None if v5 else True,
            protocol=_PROTOCOLS[self._settings.protocol],
            manual_ack=True,
        )
        client.tls_set_context(context)
        client.on_connect = self._on_connect
        client.on_subscribe = self._on_subscribe
        client.on_disconnect = self._on_disconnect
        # Without this callback, paho would write in the caller's thread.
        client.on_socket_register_write = lambda *_: None
        properties = None
        if v5:
            properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]  # paho has no annotations here
            properties.ReceiveMaximum = self._settings.receive_queue_messages
        client.connect_async(
            self._settings.host,
            self._settings.port,
            keepalive=self._settings.keepalive_s,
            clean_start=True if v5 else paho.MQTT_CLEAN_START_FIRST_ONLY,
            properties=properties,
        )
        return client

    def _connect_and_serve(self) -> bool:
        """Connect, and serve until the connection ends or the thread is stopped.

        Raises:
            ConnectionError: The connection ended.
        """
        try:
            try:
                self._client.reconnect()
            except OSError as error:
                raise ConnectionError(f"cannot connect: {error}") from error
            self._serve()
            if self._thread.stopping.is_set():
                self._disconnect()
                return False
            raise ConnectionError(self._fault or "connection lost")
        finally:
            self._subscribed = False
            self._fault = None

    def _serve(self) -> None:
        """Read and write until the connection ends or the thread is stopped."""
        while isinstance(tls := self._client.socket(), BufferedSocket):
            if self._thread.stopping.is_set():
                return
            holding = self._is_holding_back()
            if holding or tls.drained:
                self._wait(tls, read=not holding)
            if not holding and self._read(tls):
                return
            if self._write(tls) or self._client.loop_misc():
                return

    def _is_holding_back(self) -> bool:
        """Whether the receive queue is full, but not for so long that pings would be missed."""
        if not self._receive_queue.full:
            self._had_room = True
            return False
        now = time.monotonic()
        # A long time without a check does not mean that there was room.
        if self._had_room and now > self._full_checked + _FULL_TICK_S * 20:
            self._full_since = now
        self._full_checked, self._had_room = now, False
        return now <= self._full_since + self._settings.keepalive_s / 2

    def _wait(self, tls: BufferedSocket, *, read: bool) -> None:
        """Wait for I/O. While the queue is full nothing is read, so TCP holds the broker back."""
        writing = [tls] if tls.unsent else []
        reading = [tls, self._wake_out] if read else [self._wake_out]
        readable, _, _ = select.select(reading, writing, [], _TICK_S if read else _FULL_TICK_S)
        if self._wake_out in readable:
            self._wake_out.recv(4096)

    def _read(self, tls: BufferedSocket) -> bool:
        """Read what has arrived, up to a batch; return whether the connection ended."""
        for _ in range(_READS):
            # The socket does not block, so this returns at once.
            if self._client.loop_read():
                return True
            if tls.drained or self._receive_queue.full:
                return False
        return False

    def receive(self, message: paho.MQTTMessage) -> None:
        """Queue a message. Of an oversized one, one byte too many is enough to reject it."""
        if message.topic.startswith(_ALARMS):
            self._on_alarm(message.topic, bytes(message.payload))
            return
        if not self.accepting:
            return
        payload = bytes(message.payload[: MOST_ENVELOPE + 1])
        received_message = ReceivedMessage(
            message.topic, payload, message.mid, message.qos, message.retain, self.connection
        )
        if not self._receive_queue.put([received_message]):
            # The node sends it again; without a PUBACK it would fill the broker's window.
            self.acknowledge([received_message])

    def _write(self, tls: BufferedSocket) -> bool:
        """Write what other threads queued; return whether the connection ended."""
        self._write_queued(tls)
        if self._client.want_write() and self._client.loop_write():
            return True
        tls.flush()
        return False

    def _write_queued(self, tls: BufferedSocket) -> None:
        while not tls.congested and (packet := self._send_queue.take(self.connection)) is not None:
            tls.send(packet)

    def _disconnect(self) -> None:
        tls = self._client.socket()
        if self._client.is_connected() and isinstance(tls, BufferedSocket):
            self._write_queued(tls)
            self._client.loop_write()
            with suppress(OSError):
                tls.settimeout(_DISCONNECT_S)
                tls.flush()
            self._client.disconnect()
            self._client.loop_write()

    def _wake(self) -> None:
        try:
            self._wake_in.send(b"\0")
        except BlockingIOError:
            return  # enough wake-ups are pending

    def _on_connect(
        self, client: paho.Client, userdata: Any, flags: Any, code: ReasonCode, properties: Any
    ) -> None:
        del userdata, flags, properties
        if code.is_failure:
            self._lose(f"broker refuses: {code}")
            return
        self.connection += 1
        shared = f"$share/{self._settings.group}/" if self._settings.group else ""
        # Every gateway needs every layout, and every status: it carries the certificate. It is
        # retained, and a shared subscription gets no retained messages.
        wanted = [
            shared + node_topic("+", Stream.FRAMES),
            shared + node_topic("+", Stream.EVENTS),
            node_topic("+", Stream.LAYOUTS),
            node_topic("+", Stream.STATUS),
        ]
        # Alarms are sent back to the gateway that publishes them, so that it knows of them.
        chosen = [*((topic, 1) for topic in wanted), (alarm_topic("+"), 0)]
        if self._v5:
            client.subscribe([(topic, SubscribeOptions(qos=qos)) for topic, qos in chosen])
        else:
            client.subscribe(chosen)

    def _on_subscribe(
        self, client: paho.Client, userdata: Any, mid: int, codes: list[ReasonCode], properties: Any
    ) -> None:
        del client, userdata, mid, properties
        if any(code.is_failure for code in codes):
            self._lose("broker refuses the subscriptions; check its ACL for this gateway")
            return
        self._thread.succeeded()
        self._fault = None
        self._subscribed = True
        log.info("broker connected: host=%s port=%d", self._settings.host, self._settings.port)

    def _on_disconnect(
        self, client: paho.Client, userdata: Any, flags: Any, code: ReasonCode, properties: Any
    ) -> None:
        del client, userdata, flags, properties
        self._lose(f"connection lost: {code}")

    def _lose(self, fault: str) -> None:
        self._fault = self._fault or fault  # before: a reader that sees no connection sees why
        self._subscribed = False


class _PahoClient(paho.Client):
    """Hands each message to one receiver.

    paho looks for receivers by topic, under two locks: a third of the cost of reading a message.

    Args:
        receive: Takes messages.
        options: paho's.
    """

    def __init__(self, *, receive: Callable[[paho.MQTTMessage], None], **options: Any) -> None:
        super().__init__(CallbackAPIVersion.VERSION2, **options)
        self._receive = receive
        self.on_socket_open = set_nodelay

    def _handle_on_message(self, message: paho.MQTTMessage) -> None:
        self._receive(message)
