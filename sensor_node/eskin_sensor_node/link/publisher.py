"""The publisher: seals messages of the outbox, sends them, and takes acknowledgements."""

from __future__ import annotations

import logging
import queue
import socket
import sys
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from eskin.errors import EnvelopeError, FlashError, MessageError
from eskin.runtime.net import set_nodelay
from eskin.wire.envelope import MOST_ENVELOPE
from eskin.wire.messages import Acknowledgement
from eskin.wire.sequence_set import SequenceRanges
from eskin.wire.topics import Stream, node_topic
from eskin_sensor_node.link.keys import NodeKeys
from eskin_sensor_node.link.uplink import Uplink
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.machine.radio import Radio
    from eskin_sensor_node.settings import BrokerSection, IdentitySection


log = logging.getLogger(__name__)

_MOST_ACKNOWLEDGEMENTS: Final = 1000
_MOST_COMMANDS: Final = 16
_TURN_S: Final = 0.1
_PAUSE_S: Final = 1.0
_LONGEST: Final = 16
"""Greatest factor of the patience: without a gateway, reconnects become rare."""


class ReconnectTimer:
    """Decides when to close a connection that carries no acknowledgements.

    A broker may take messages and lead them nowhere, or forget a subscription, and keep the
    connection alive all the while; a new connection is the only remedy a node has.

    Args:
        patience: Seconds without an answer until the first new connection; doubled with each
            further one.
    """

    def __init__(self, patience: float) -> None:
        self._first = self._patience = patience
        self._since: float | None = None

    def connected(self, now: float) -> None:
        """A connection stands; now: monotonic seconds."""
        self._since = now

    def answered(self, now: float) -> None:
        """A gateway has acknowledged something."""
        self._since = now
        self._patience = self._first

    def is_too_long(self, now: float, *, waiting: bool) -> bool:
        """Whether to reconnect; asked once for each connection.

        Args:
            now: Monotonic seconds.
            waiting: Whether messages wait for an answer; else silence means nothing.
        """
        if self._since is None:
            return False
        if not waiting:
            self._since = now
        if now < self._since + self._patience:
            return False
        self._since = None
        self._patience = min(2 * self._patience, _LONGEST * self._first)
        return True


class Publisher:
    """Carries messages from the outbox to the broker, and acknowledgements and commands back.

    Threads: paho's own, which only takes what arrives into queues; and one that seals, sends,
    acknowledges, and takes commands.

    Args:
        outbox: Decides what to send and when; its times are ns of the monotonic clock.
        radio: The air that every message crosses.
        broker: Where to publish.
        identity: The node's identity, and its site.
        record_status: Puts a fresh status into the outbox.
        take_command: Takes a command that was sealed to this node; ``None``: it takes none.
        is_running: Whether the firmware runs; while it does not, nothing is sent or taken.
        client: Takes the place of paho's client, for example in a simulation.
        clock: Monotonic ns.

    Raises:
        IdentityError: A key or certificate cannot be used.
    """

    def __init__(  # noqa: PLR0913 - all that a node's radio carries, and what runs it
        self,
        outbox: Outbox,
        *,
        radio: Radio,
        broker: BrokerSection,
        identity: IdentitySection,
        record_status: Callable[[], object],
        take_command: Callable[[bytes], None] | None = None,
        is_running: Callable[[], bool] = lambda: True,
        client: mqtt.Client | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._keys = NodeKeys(identity.directory, identity.site)
        self._outbox = outbox
        self._record_status, self._take_command = record_status, take_command
        self._is_running = is_running
        self._clock = clock
        self._broker = broker
        name = self._keys.own.name
        self._acks_topic = node_topic(name, Stream.ACKS)
        self._commands_topic = node_topic(name, Stream.COMMANDS)
        self._inboxes: dict[str, queue.Queue[bytes]] = {
            self._acks_topic: queue.Queue(_MOST_ACKNOWLEDGEMENTS)
        }
        if take_command is not None:
            self._inboxes[self._commands_topic] = queue.Queue(_MOST_COMMANDS)
        self._fresh, self._wake = threading.Event(), threading.Event()
        self._until = float("inf")
        self._ended = False
        self._reconnect_timer = ReconnectTimer(broker.silence_s)
        self._client = client or self._make_client()
        self._client.on_connect, self._client.on_disconnect = self._on_connect, self._on_disconnect
        self._client.on_connect_fail = self._on_connect_fail
        self._client.on_message = self._on_message
        self._uplink = Uplink(
            outbox,
            self._client,
            node=name,
            keys=self._keys,
            radio=radio,
            ahead_s=2 * _TURN_S,
            patience=round(broker.resend_s * BILLION),
        )
        self._thread = threading.Thread(target=self._run, name="publisher", daemon=True)

    def start(self) -> None:
        """Connect, and go on trying."""
        self._client.connect_async(
            self._broker.host, self._broker.port, keepalive=self._broker.keepalive_s
        )
        self._client.loop_start()
        self._thread.start()

    def stop(self) -> None:
        """Wait a little for acknowledgements, then disconnect; what is left waits."""
        self._until = time.monotonic() + self._broker.drain_s
        self._wake.set()
        self._thread.join()
        self._client.disconnect()
        self._client.loop_stop()

    def notify(self) -> None:
        """Wake the thread: the outbox holds something new."""
        self._wake.set()

    def _make_client(self) -> mqtt.Client:
        client = mqtt.Client(
            CallbackAPIVersion.VERSION2, client_id=self._keys.own.name, clean_session=True
        )
        client.tls_set_context(self._keys.context)
        client.max_inflight_messages_set(self._broker.window)
        client.max_queued_messages_set(4 * self._broker.window)
        client.reconnect_delay_set(min_delay=1, max_delay=8)
        client.on_socket_open = set_nodelay
        return client

    def _on_connect(
        self, client: mqtt.Client, _data: Any, _flags: Any, reason: Any, _properties: Any
    ) -> None:
        if reason.is_failure:
            log.error("connection refused: reason=%s", reason)
            return
        log.info("connected: broker=%s:%d", self._broker.host, self._broker.port)
        client.subscribe([(topic, 1) for topic in self._inboxes])
        self._fresh.set()
        self._wake.set()

    def _on_connect_fail(self, _client: mqtt.Client, _data: Any) -> None:
        log.warning(
            "broker unreachable: broker=%s:%d reason=%s",
            self._broker.host,
            self._broker.port,
            sys.exception(),  # which paho is about to drop
        )

    def _on_disconnect(
        self, _client: mqtt.Client, _data: Any, _flags: Any, reason: Any, _properties: Any
    ) -> None:
        if not self._ended:
            log.warning("connection lost: reason=%s", reason)

    def _on_message(self, _client: mqtt.Client, _data: Any, message: mqtt.MQTTMessage) -> None:
        inbox = self._inboxes.get(message.topic)
        if inbox is None:
            log.warning("message ignored: topic=%.200r", message.topic)
            return
        if len(message.payload) > MOST_ENVELOPE:
            log.warning("message ignored: topic=%s bytes=%d", message.topic, len(message.payload))
            return
        try:
            if message.payload:  # without one, the broker forgets what it has kept
                inbox.put_nowait(bytes(message.payload))
        except queue.Full:
            log.warning("message dropped: topic=%s reason=queue_full", message.topic)
        self._wake.set()

    def _run(self) -> None:
        failures = 0
        while not self._has_ended():
            self._wake.wait(_TURN_S)
            self._wake.clear()
            try:
                self.turn()
            except FlashError as error:
                log.warning("publishing paused: error=%s", error)
                time.sleep(_PAUSE_S)
            except Exception:
                failures += 1
                log.exception("publisher failed, continuing: failures=%d", failures)
                time.sleep(_PAUSE_S)

    def _has_ended(self) -> bool:
        """Whether nothing is left to wait for; asked between turns, which may add a status."""
        if self._until < float("inf"):
            more = self._client.is_connected() and self._outbox.messages
            self._ended = not more or time.monotonic() >= self._until
        return self._ended

    def turn(self) -> None:
        """Take what has come, then send what is due.

        Raises:
            FlashError: The flash cannot be read or written.
        """
        if not self._is_running():
            return
        self._take_acknowledgements()
        self._take_commands()
        now = self._clock()
        if self._keys.refresh(now / BILLION):
            # A gateway cannot decrypt before it has seen the certificate.
            self._outbox.introduce(now)
        if not self._client.is_connected():
            return
        if self._fresh.is_set():
            self._fresh.clear()
            self._uplink.connect()
            self._outbox.connect(now)
            self._reconnect_timer.connected(now / BILLION)
        if self._reconnect_timer.is_too_long(now / BILLION, waiting=self._outbox.messages > 0):
            self._reconnect()
            return
        self._uplink.report(now)
        self._update_status(now)
        self._uplink.send_due(now)

    def _reconnect(self) -> None:
        """Let paho find the connection ended, upon which it makes another."""
        log.warning("no acknowledgement, reconnecting")
        own = self._client.socket()
        if isinstance(own, socket.socket):
            with suppress(OSError):
                # Not TLS's close_notify: paho's thread uses the TLS object.
                socket.socket.shutdown(own, socket.SHUT_RDWR)

    def _opened(self, topic: str, what: str) -> Iterator[bytes]:
        """What came on a topic, as far as the site has sealed it to this node."""
        inbox = self._inboxes[topic]
        while True:
            try:
                payload = inbox.get_nowait()
            except queue.Empty:
                return
            self._uplink.count_received(topic, payload)
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
                received = Acknowledgement.decode(plaintext)
                self._outbox.message_writer.observe_time(received.time)
                for boot, first, last in received.spans:
                    durable.setdefault(boot, SequenceRanges()).add(first, last)
                self._uplink.describe(received.want, self._clock())
            except MessageError as error:
                log.warning("acknowledgement rejected: reason=%s", error)
        if durable:
            self._outbox.acknowledge(
                [(boot, first, last) for boot, ranges in durable.items() for first, last in ranges]
            )
            self._reconnect_timer.answered(self._clock() / BILLION)

    def _update_status(self, now: int) -> None:
        """Record a status if one is due; the first introduces the node to the gateway."""
        if not self._outbox.is_status_due(now):
            return
        try:
            self._record_status()
        except FlashError as error:
            # Waiting messages must still be sent: that frees the flash.
            log.warning("status postponed: error=%s", error)
