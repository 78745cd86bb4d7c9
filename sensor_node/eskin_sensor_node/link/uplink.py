"""The uplink from the outbox over the air to the broker."""

from __future__ import annotations

import itertools
import logging
from collections import deque
from typing import TYPE_CHECKING, Final, NamedTuple

import paho.mqtt.client as mqtt

from eskin.wire.messages import Kind, Position
from eskin.wire.topics import Stream, node_topic

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eskin_sensor_node.firmware import chip
    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.link.keys import NodeKeys
    from eskin_sensor_node.machine.radio import Radio

log = logging.getLogger(__name__)

STREAMS: Final = {
    Kind.STATUS: Stream.STATUS,
    Kind.RESULT: Stream.EVENTS,
    Kind.FRAME: Stream.FRAMES,
    Kind.STATEMENTS: Stream.EVENTS,
}
_AT_ONCE: Final = 16
"""Messages that are taken from the outbox at once."""
_PUBACK: Final = 4
"""Bytes (MQTT 3.1.1, section 3.4)."""


class _Transmission(NamedTuple):
    """A sealed message on the air, named by its position, or a description by its hash."""

    named: chip.Position | bytes
    topic: str
    envelope: bytes
    retained: bool
    end: int
    """Emulated ns."""
    arrives: bool


class Uplink:
    """Messages that have left the outbox: on the air, or with the broker's client.

    Args:
        outbox: Decides what to send.
        client: Takes what has crossed the air.
        node: The node's name.
        keys: Seal to the site.
        radio: The air.
        ahead_s: Real seconds for which the air is kept busy.
        patience: ns for which a description that was sent is not sent again.
    """

    def __init__(
        self,
        outbox: Outbox,
        client: mqtt.Client,
        *,
        node: str,
        keys: NodeKeys,
        radio: Radio,
        ahead_s: float,
        patience: int,
    ) -> None:
        self._outbox = outbox
        self._client = client
        self._node = node
        self._keys = keys
        self._radio = radio
        self._ahead_s = ahead_s
        self._patience = patience
        # In the order in which they are sent.
        self._descriptions: dict[bytes, None] = {}
        self._described: dict[bytes, int] = {}
        self._introduced = True
        self._aired: deque[_Transmission] = deque()
        # What paho still has: its window, and what waits behind.
        self._deliveries: dict[chip.Position, mqtt.MQTTMessageInfo] = {}

    def connect(self) -> None:
        """After a new connection, forget what is in flight, and send all descriptions."""
        self._aired.clear()
        self._deliveries.clear()
        self._described.clear()
        self._introduced = False
        self._descriptions = dict.fromkeys(self._outbox.descriptions())

    def describe(self, wanted: Iterable[bytes], now: int) -> None:
        """Send descriptions that a gateway lacks, by their hashes; now: monotonic ns."""
        for name in wanted:
            sent = self._described.get(name)
            if sent is None or now - sent > self._patience:
                self._descriptions[name] = None

    def count_received(self, topic: str, payload: bytes) -> None:
        """Count a message that came, and its acknowledgement to the broker."""
        self._radio.receive(publish_size(topic, payload))
        self._radio.send(_PUBACK)

    def send_due(self, now: int) -> None:
        """Send what is due, as far as the air has room until the next turn; now: monotonic ns."""
        # Once a turn is enough: a lower position than the true one is safe.
        held = Position(*self._outbox.held())
        # With a status a gateway knows the node, with the descriptions it can read frames.
        if not self._introduced:
            self._send(deque(self._outbox.due(now, 1)), held, now)
            self._introduced = True
        self._send_descriptions(held, now)
        while not self._descriptions and self._radio.is_free(self._ahead_s):
            due = self._outbox.due(now, _AT_ONCE)
            if not due:
                break
            self._send(deque(due), held, now)
        self._pass_on(now)

    def report(self, now: int) -> None:
        """Mark what the broker has taken as sent: its acknowledgement is awaited from now on."""
        # A broker acknowledges in order.
        for position in list(itertools.takewhile(self._left, self._deliveries)):
            del self._deliveries[position]
            self._radio.receive(_PUBACK)
            self._outbox.mark_sent(position, now)

    def _left(self, position: chip.Position) -> bool:
        """Whether paho is done with it: the broker has it, or there was no room in the queue."""
        delivery = self._deliveries[position]
        if delivery.rc == mqtt.MQTT_ERR_QUEUE_SIZE:
            return True
        return delivery.rc == mqtt.MQTT_ERR_SUCCESS and delivery.is_published()

    def _send_descriptions(self, held: Position, now: int) -> None:
        topic = node_topic(self._node, Stream.LAYOUTS)
        while self._descriptions and self._radio.is_free(self._ahead_s):
            name = next(iter(self._descriptions))
            body = self._outbox.description(name)
            if body is None:
                log.warning("description not sent, unknown: hash=%s", name.hex())
            else:
                envelope = self._keys.sealer.seal(body, topic=topic, held=held)
                end, arrives = self._radio.send(publish_size(topic, envelope))
                self._aired.append(
                    _Transmission(name, topic, envelope, retained=False, end=end, arrives=arrives)
                )
            self._described[name] = now
            del self._descriptions[name]

    def _send(self, due: deque[chip.StoredMessage], held: Position, now: int) -> None:
        try:
            while due:
                self._aired.append(self._air(due[0], held))
                due.popleft()
        finally:
            for kept in due:
                self._outbox.mark_sent(kept.position, now)

    def _air(self, kept: chip.StoredMessage, held: Position) -> _Transmission:
        topic = node_topic(self._node, STREAMS[Kind(kept.kind)])
        status = kept.kind == Kind.STATUS
        envelope = self._keys.sealer.seal(kept.body, topic=topic, held=held, introduce=status)
        newest = status and kept.position == self._outbox.newest_status
        end, arrives = self._radio.send(publish_size(topic, envelope))
        return _Transmission(kept.position, topic, envelope, newest, end, arrives)

    def _pass_on(self, now: int) -> None:
        """Give the broker what has crossed the air by now."""
        while self._aired and self._radio.has_reached(self._aired[0].end):
            aired = self._aired.popleft()
            delivery = None
            if aired.arrives:
                delivery = self._client.publish(
                    aired.topic, aired.envelope, qos=1, retain=aired.retained
                )
            if isinstance(aired.named, bytes):
                if delivery is None or delivery.rc == mqtt.MQTT_ERR_QUEUE_SIZE:
                    self._descriptions[aired.named] = None
            elif delivery is None:
                self._outbox.mark_sent(aired.named, now)
            else:
                self._deliveries[aired.named] = delivery


def publish_size(topic: str, payload: bytes | bytearray, qos: int = 1) -> int:
    """Bytes of MQTT's PUBLISH (MQTT 3.1.1, section 3.3)."""
    remaining = 2 + len(topic) + 2 * qos + len(payload)
    return 1 + max(1, -(-remaining.bit_length() // 7)) + remaining
