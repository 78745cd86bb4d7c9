"""From flash to the broker: sealed, sent, and kept until a gateway acknowledges."""

from __future__ import annotations

import logging
import queue
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from eskin.errors import EnvelopeError, FlashError, MessageError
from eskin.messages import Acknowledgement, Kind
from eskin.sequences import SequenceRanges
from eskin.topics import Stream, node_topic
from sensor_node.keys import NodeKeys

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from eskin.messages import Position
    from sensor_node.flash import Flash
    from sensor_node.settings import BrokerSection, IdentitySection
    from sensor_node.stored import Stored

log = logging.getLogger(__name__)

_STREAMS: Final = {
    Kind.BLOCK: Stream.BLOCKS,
    Kind.PEAK: Stream.EVENTS,
    Kind.GAP: Stream.EVENTS,
    Kind.STATUS: Stream.STATUS,
    Kind.RESULT: Stream.EVENTS,
}
_MOST_ACKNOWLEDGEMENTS: Final = 1000
_MOST_COMMANDS: Final = 16
_TURN_S: Final = 0.1


@dataclass(slots=True)
class _Flight:
    """A message under way."""

    sent: float
    delivery: mqtt.MQTTMessageInfo


class Publisher:
    """Publishes what waits in flash, oldest first, within a window.

    Threads: paho's own, which only takes what arrives into queues; and one that seals, sends,
    forgets, and takes commands.

    Args:
        flash: The outbox.
        record_status: Puts a fresh status into flash and gives its position.
        take_command: Takes a command that was sealed to this node; ``None``: it obeys none.
        broker: Where to publish.
        identity: Who the node is, and its site.

    Raises:
        IdentityError: A key or certificate cannot be used.
    """

    def __init__(
        self,
        flash: Flash,
        *,
        record_status: Callable[[], Position],
        take_command: Callable[[bytes], None] | None = None,
        broker: BrokerSection,
        identity: IdentitySection,
    ) -> None:
        self._keys = NodeKeys(identity)
        self._flash = flash
        self._record_status = record_status
        self._take_command = take_command
        self._broker = broker
        self._node = self._keys.own.name
        self._acks_topic = node_topic(self._node, Stream.ACKS)
        self._commands_topic = node_topic(self._node, Stream.COMMANDS)
        self._inboxes: dict[str, queue.Queue[bytes]] = {
            self._acks_topic: queue.Queue(_MOST_ACKNOWLEDGEMENTS)
        }
        if take_command is not None:
            self._inboxes[self._commands_topic] = queue.Queue(_MOST_COMMANDS)
        self._flights: dict[Position, _Flight] = {}
        self._sent_up_to: Position | None = None
        self._newest_status: Position | None = None
        self._held: Position | None = None
        self._status_due = 0.0
        self._fresh = threading.Event()
        self._wake = threading.Event()
        self._stopping = threading.Event()
        self._client = self._make_client()
        self._thread = threading.Thread(target=self._run, name="publisher", daemon=True)

    def start(self) -> None:
        """Connect, and go on trying."""
        self._client.connect_async(
            self._broker.host, self._broker.port, keepalive=self._broker.keepalive_s
        )
        self._client.loop_start()
        self._thread.start()

    def stop(self) -> None:
        """Wait a little for acknowledgements, then disconnect; what is left waits in flash."""
        deadline = time.monotonic() + self._broker.drain_s
        while self._client.is_connected() and self._flash.usage().messages:
            if time.monotonic() >= deadline:
                break
            self._stopping.wait(0.05)
        self._stopping.set()
        self._wake.set()
        self._thread.join()
        self._client.disconnect()
        self._client.loop_stop()

    def notify(self) -> None:
        """Say that flash holds something new."""
        self._wake.set()

    def _make_client(self) -> mqtt.Client:
        client = mqtt.Client(CallbackAPIVersion.VERSION2, client_id=self._node, clean_session=True)
        client.tls_set_context(self._keys.context)
        client.max_inflight_messages_set(self._broker.window)
        client.max_queued_messages_set(4 * self._broker.window)
        client.reconnect_delay_set(min_delay=1, max_delay=8)
        client.on_connect = self._on_connect
        client.on_connect_fail = self._on_connect_fail
        client.on_disconnect = self._on_disconnect
        client.on_message = self._on_message
        return client

    def _on_connect(
        self, client: mqtt.Client, _data: Any, _flags: Any, reason: Any, _properties: Any
    ) -> None:
        if reason.is_failure:
            log.error("broker refuses: reason=%s", reason)
            return
        log.info("connected: broker=%s:%d", self._broker.host, self._broker.port)
        client.subscribe([(topic, 1) for topic in self._inboxes])
        self._fresh.set()
        self._wake.set()

    def _on_connect_fail(self, _client: mqtt.Client, _data: Any) -> None:
        log.warning(
            "broker cannot be reached, messages wait in flash: broker=%s:%d",
            self._broker.host,
            self._broker.port,
        )

    def _on_disconnect(
        self, _client: mqtt.Client, _data: Any, _flags: Any, reason: Any, _properties: Any
    ) -> None:
        if not self._stopping.is_set():
            log.warning("connection lost, messages wait in flash: reason=%s", reason)

    def _on_message(self, _client: mqtt.Client, _data: Any, message: mqtt.MQTTMessage) -> None:
        inbox = self._inboxes.get(message.topic)
        if inbox is None:
            log.warning("message ignored: topic=%.200r", message.topic)
            return
        try:
            if message.payload:  # without one, the broker forgets what it has kept
                inbox.put_nowait(bytes(message.payload))
        except queue.Full:
            log.warning("message dropped, it will come again: topic=%s queue=full", message.topic)
        self._wake.set()

    def _run(self) -> None:
        failures = 0
        while not self._stopping.is_set():
            self._wake.wait(_TURN_S)
            self._wake.clear()
            try:
                self._turn()
            except FlashError as error:
                log.warning("publishing pauses: error=%s", error)
                self._stopping.wait(1.0)
            except Exception:
                failures += 1
                log.exception("publisher failed and goes on: failures=%d", failures)
                self._stopping.wait(1.0)

    def _turn(self) -> None:
        self._take_acknowledgements()
        self._take_commands()
        now = time.monotonic()
        if self._keys.refresh(now):
            self._introduce(now)
        if not self._client.is_connected():
            return
        # Once a turn is enough: a lower position than the true one is safe.
        self._held = self._flash.held()
        if self._fresh.is_set():
            self._fresh.clear()
            self._flights.clear()
            self._sent_up_to = None
            self._introduce(now)
        # One unanswered status is enough: it is sent again, and more would only pile up.
        if now >= self._status_due and self._newest_status not in self._flights:
            self._status_due = now + self._broker.status_s
            self._send_status()
        self._send_again(now)
        self._send_new()

    def _introduce(self, now: float) -> None:
        """Before anything else: a gateway opens nothing of a certificate that it has not seen."""
        self._newest_status, self._status_due = None, now

    def _opened(self, topic: str, what: str) -> Iterator[bytes]:
        """What came on a topic, as far as the site has sealed it to this node."""
        inbox = self._inboxes[topic]
        while True:
            try:
                payload = inbox.get_nowait()
            except queue.Empty:
                return
            try:
                yield self._keys.opener.open(payload, topic=topic).plaintext
            except EnvelopeError as error:
                log.warning("%s rejected: reason=%s", what, error)

    def _take_commands(self) -> None:
        if self._take_command is not None:
            for signed in self._opened(self._commands_topic, "command"):
                self._take_command(signed)

    def _take_acknowledgements(self) -> None:
        durable: dict[int, SequenceRanges] = {}
        for plaintext in self._opened(self._acks_topic, "acknowledgement"):
            try:
                for boot, first, last in Acknowledgement.decode(plaintext).spans:
                    durable.setdefault(boot, SequenceRanges()).add(first, last)
            except MessageError as error:
                log.warning("acknowledgement rejected: reason=%s", error)
        if durable:
            self._flash.forget(
                (boot, first, last) for boot, ranges in durable.items() for first, last in ranges
            )
            for position in list(self._flights):
                if position.sequence in durable.get(position.boot, ()):
                    del self._flights[position]

    def _send_status(self) -> None:
        """First of all after connecting: it introduces the node to the gateway."""
        try:
            self._newest_status = self._record_status()
        except FlashError as error:
            # What waits must still go out: it makes the room that is missing.
            log.warning("status postponed: error=%s", error)
            return
        stored = self._flash.read(self._newest_status)
        if stored is not None:
            self._send(stored)

    def _send_again(self, now: float) -> None:
        late = [
            position
            for position, flight in self._flights.items()
            if now - flight.sent > self._broker.resend_s and _left(flight.delivery)
        ]
        for position in sorted(late):
            stored = self._flash.read(position)
            if stored is None:
                del self._flights[position]
            else:
                self._send(stored)

    def _send_new(self) -> None:
        while (room := self._broker.window - len(self._flights)) > 0:
            found = self._flash.pending(self._sent_up_to, room)
            for stored in found:
                self._sent_up_to = stored.position
                if stored.position not in self._flights:
                    self._send(stored)
            if len(found) < room:
                return

    def _send(self, stored: Stored) -> None:
        kind = Kind(stored.kind)
        topic = node_topic(self._node, _STREAMS[kind])
        status = kind is Kind.STATUS
        envelope = self._keys.sealer.seal(
            stored.body, topic=topic, held=self._held, introduce=status
        )
        newest = status and stored.position == self._newest_status
        delivery = self._client.publish(topic, envelope, qos=1, retain=newest)
        self._flights[stored.position] = _Flight(time.monotonic(), delivery)


def _left(delivery: mqtt.MQTTMessageInfo) -> bool:
    """Whether paho is done with it: the broker has it, or paho's queue had no room for it."""
    if delivery.rc == mqtt.MQTT_ERR_QUEUE_SIZE:
        return True
    return delivery.rc == mqtt.MQTT_ERR_SUCCESS and delivery.is_published()
