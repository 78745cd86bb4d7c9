"""The broker over MQTT: paho's client, driven by a thread of ours.

paho's own thread wakes for each packet that another thread hands it. Ours takes a whole batch of
PUBACKs and publications at once, and outlives whatever a broken broker sends.
"""

from __future__ import annotations

import logging
import select
import socket
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

import paho.mqtt.client as paho
from paho.mqtt.enums import MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.subscribeoptions import SubscribeOptions

from eskin.wire.topics import Stream, node_topic
from eskin_gateway.mqtt.buffered_socket import BufferedSocket
from eskin_gateway.mqtt.mqtt_packets import write_acknowledgements, write_publication
from eskin_gateway.mqtt.paho_client import PahoClient
from eskin_gateway.mqtt.receiver import Receiver
from eskin_gateway.mqtt.send_queue import SendQueue

if TYPE_CHECKING:
    import ssl
    from collections.abc import Iterable, Sequence

    from paho.mqtt.reasoncodes import ReasonCode

    from eskin_gateway.backoff import Backoff
    from eskin_gateway.mqtt.receive_queue import ReceiveQueue
    from eskin_gateway.mqtt.received_message import ReceivedMessage
    from eskin_gateway.settings import BrokerSection

log = logging.getLogger(__name__)

_PROTOCOLS: Final = {"3.1.1": MQTTProtocolVersion.MQTTv311, "5": MQTTProtocolVersion.MQTTv5}
_TICK_S: Final = 0.5
_READS: Final = 64
_FULL_TICK_S: Final = 0.005
_FAREWELL_S: Final = 1.0


class MqttTransport:
    """A connection that comes back by itself.

    Args:
        settings: Where, and how.
        name: The gateway's name, also its client id.
        context: Shows the gateway's certificate, and checks the broker's.
        receive_queue: Takes what arrives.
        backoff: Between attempts to connect.
    """

    def __init__(
        self,
        settings: BrokerSection,
        *,
        name: str,
        context: ssl.SSLContext,
        receive_queue: ReceiveQueue,
        backoff: Backoff,
    ) -> None:
        self._settings = settings
        self._receive_queue = receive_queue
        self._backoff = backoff
        self._stopping = threading.Event()
        self._send_queue = SendQueue()
        self._wake_in, self._wake_out = socket.socketpair()
        for end in (self._wake_in, self._wake_out):
            end.settimeout(0.0)
        self._subscribed = False
        self._full_seen = self._full_since = float("-inf")
        self._had_room = True
        self.dropped = 0
        self.fault: str | None = "not connected yet"
        self._five = settings.protocol == "5"
        self._received_messages = Receiver(receive_queue, five=self._five, release=self.acknowledge)
        self._client = self._make_client(name, context)
        self._thread = threading.Thread(target=self._run, name="broker", daemon=True)

    def start(self) -> None:
        """Connect, and keep connected, in a thread."""
        self._thread.start()

    def refuse(self) -> None:
        """Take no further messages; answers still go out."""
        self._received_messages.accepting = False

    def stop(self) -> None:
        """Send what waits, say goodbye, and end the thread."""
        self._stopping.set()
        self._wake()
        self._thread.join()
        self._wake_in.close()
        self._wake_out.close()

    @property
    def connected(self) -> bool:
        """Whether the broker has granted all subscriptions."""
        return self._subscribed

    def acknowledge(self, received_messages: Sequence[ReceivedMessage]) -> None:
        """Send PUBACKs."""
        by_connection: dict[int, list[int]] = {}
        for received_message in received_messages:
            if received_message.qos:
                by_connection.setdefault(received_message.connection, []).append(
                    received_message.mid
                )
        for connection, mids in by_connection.items():
            self._send_queue.acknowledge(write_acknowledgements(mids), connection=connection)
        self._wake()

    def publish(self, publications: Iterable[tuple[str, bytes, bool]]) -> None:
        """Publish at QoS 0; dropped and counted where there is no broker, or it does not read."""
        for topic, payload, retain in publications:
            packet = write_publication(topic, payload, retain=retain, five=self._five)
            if not self._subscribed or not self._send_queue.put(packet):
                self.dropped += 1
        self._wake()

    def _make_client(self, name: str, context: ssl.SSLContext) -> PahoClient:
        five = self._five
        # The context makes the sockets of this connection alone.
        context.sslsocket_class = BufferedSocket
        client = PahoClient(
            take=self._received_messages.take_read,
            client_id=name,
            clean_session=None if five else True,
            protocol=_PROTOCOLS[self._settings.protocol],
            manual_ack=True,
        )
        client.tls_set_context(context)
        client.on_connect = self._on_connect
        client.on_subscribe = self._on_subscribe
        client.on_disconnect = self._on_disconnect
        # Tells paho that a loop of ours writes; otherwise it would write in the caller's thread.
        client.on_socket_register_write = lambda *_: None
        properties = None
        if five:
            properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]  # paho has no annotations here
            properties.ReceiveMaximum = self._settings.receive_queue_messages
        client.connect_async(
            self._settings.host,
            self._settings.port,
            keepalive=self._settings.keepalive_s,
            clean_start=True if five else paho.MQTT_CLEAN_START_FIRST_ONLY,
            properties=properties,
        )
        return client

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                self._client.reconnect()
                self._serve()
            except OSError as error:
                self._lost(f"cannot connect: {error}")
            except Exception:  # the thread's outermost loop: a broken broker must not end it
                log.exception("broker: unexpected failure; connecting again")
                self._lost("unexpected failure")
            self._stopping.wait(0 if self._stopping.is_set() else self._backoff.failed())
        self._farewell()

    def _serve(self) -> None:
        """Read and write until the connection ends or the thread shall."""
        while isinstance(own := self._client.socket(), BufferedSocket):
            if self._stopping.is_set():
                return
            patient = self._is_patient()
            if patient or own.drained:
                self._wait(own, read=not patient)
            if not patient and self._read(own):
                return
            if self._write(own) or self._client.loop_misc():
                return

    def _is_patient(self) -> bool:
        """Whether the inbox is full, and not yet for so long that pings would be missed."""
        if not self._receive_queue.full:
            self._had_room = True
            return False
        now = time.monotonic()
        # That nobody looked for a while does not say that there was room.
        if self._had_room and now > self._full_seen + _FULL_TICK_S * 20:
            self._full_since = now
        self._full_seen, self._had_room = now, False
        return now <= self._full_since + self._settings.keepalive_s / 2

    def _wait(self, own: BufferedSocket, *, read: bool) -> None:
        """Wait for something to do; with a full inbox, reading is not: TCP holds the broker."""
        waiting = [own] if own.unsent else []
        reading = [own, self._wake_out] if read else [self._wake_out]
        readable, _, _ = select.select(reading, waiting, [], _TICK_S if read else _FULL_TICK_S)
        if self._wake_out in readable:
            self._wake_out.recv(4096)

    def _read(self, own: BufferedSocket) -> bool:
        """Read what is there, up to a batch; tells whether the connection ended."""
        for _ in range(_READS):
            whole = self._client.between_packets and self._received_messages.take(own)
            # The socket does not block: where nothing is there, this returns at once.
            if not whole and not own.drained and self._client.loop_read():
                return True
            if own.drained or self._receive_queue.full:
                return False
        return False

    def _write(self, own: BufferedSocket) -> bool:
        """Write what other threads left, all together; tells whether the connection ended."""
        self._hand_over(own)
        if self._client.want_write() and self._client.loop_write():
            return True
        own.flush()
        return False

    def _hand_over(self, own: BufferedSocket) -> None:
        """Write what other threads left, as long as the broker reads it."""
        while (
            not own.clogged
            and (packet := self._send_queue.take(self._received_messages.connection)) is not None
        ):
            own.send(packet)

    def _farewell(self) -> None:
        own = self._client.socket()
        if self._client.is_connected() and isinstance(own, BufferedSocket):
            self._hand_over(own)
            self._client.loop_write()
            with suppress(OSError):
                own.settimeout(_FAREWELL_S)
                own.flush()
            self._client.disconnect()
            self._client.loop_write()

    def _wake(self) -> None:
        try:
            self._wake_in.send(b"\0")
        except BlockingIOError:
            return  # enough wake-ups are under way

    def _on_connect(
        self, client: paho.Client, userdata: Any, flags: Any, code: ReasonCode, properties: Any
    ) -> None:
        del userdata, flags, properties
        if code.is_failure:
            self._lost(f"broker refuses: {code}")
            return
        self._received_messages.connection += 1
        shared = f"$share/{self._settings.group}/" if self._settings.group else ""
        # Every gateway needs every status: it carries the certificate, and is kept by the broker,
        # which gives no kept message to a shared subscription.
        wanted = [
            shared + node_topic("+", Stream.BLOCKS),
            shared + node_topic("+", Stream.EVENTS),
            node_topic("+", Stream.STATUS),
        ]
        if self._five:
            options = SubscribeOptions(qos=1)
            client.subscribe([(topic, options) for topic in wanted])
        else:
            client.subscribe([(topic, 1) for topic in wanted])

    def _on_subscribe(
        self, client: paho.Client, userdata: Any, mid: int, codes: list[ReasonCode], properties: Any
    ) -> None:
        del client, userdata, mid, properties
        if any(code.is_failure for code in codes):
            self._lost("broker refuses the subscriptions; check its ACL for this gateway")
            return
        self._backoff.succeeded()
        self.fault = None
        self._subscribed = True
        log.info("broker connected: %s:%d", self._settings.host, self._settings.port)

    def _on_disconnect(
        self, client: paho.Client, userdata: Any, flags: Any, code: ReasonCode, properties: Any
    ) -> None:
        del client, userdata, flags, properties
        if not self._stopping.is_set():
            self._lost(f"connection lost: {code}")

    def _lost(self, fault: str) -> None:
        new = fault != self.fault
        self.fault = fault  # first: whoever sees that it is lost is told why
        self._subscribed = False
        if new:
            log.warning(
                "broker: %s; trying again: %s:%d", fault, self._settings.host, self._settings.port
            )
