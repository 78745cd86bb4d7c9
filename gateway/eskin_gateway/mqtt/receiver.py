"""What the broker sends becomes arrivals in the inbox."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.wire.envelope import MOST_ENVELOPE
from eskin_gateway.mqtt.mqtt_packets import read_publication
from eskin_gateway.mqtt.received_message import ReceivedMessage

if TYPE_CHECKING:
    from collections.abc import Callable

    import paho.mqtt.client as paho

    from eskin_gateway.mqtt.buffered_socket import BufferedSocket
    from eskin_gateway.mqtt.receive_queue import ReceiveQueue


class Receiver:
    """Puts messages into the inbox. Only for one thread.

    Args:
        receive_queue: Takes them.
        five: Whether version 5 of MQTT is spoken.
        release: Lets the broker forget what found no room.

    Attributes:
        connection: Counts the connections; arrivals carry it.
        accepting: Whether messages are wanted at all.
    """

    def __init__(
        self,
        receive_queue: ReceiveQueue,
        *,
        five: bool,
        release: Callable[[list[ReceivedMessage]], None],
    ) -> None:
        self._receive_queue = receive_queue
        self._five = five
        self._release = release
        self.connection = 0
        self.accepting = True

    def take(self, own: BufferedSocket) -> bool:
        """Take ordinary messages off the front of what came; tells whether there were any.

        Raises:
            OSError: The connection ended.
        """
        if not own.fill():
            return False
        data, at = own.at_hand
        found: list[ReceivedMessage] = []
        most = self._receive_queue.room or len(data)
        while len(found) < most:
            one = read_publication(data, at, five=self._five)
            if one is None:
                break
            at, topic, payload, mid, qos, retained = one
            # One byte too long is known as too long; the rest would only fill the memory.
            payload = payload[: MOST_ENVELOPE + 1]
            found.append(ReceivedMessage(topic, payload, mid, qos, retained, self.connection))
        own.skip(at)
        self._put(found)
        return bool(found)

    def take_read(self, message: paho.MQTTMessage) -> None:
        """Take one that paho read."""
        payload = bytes(message.payload[: MOST_ENVELOPE + 1])
        self._put([
            ReceivedMessage(
                message.topic, payload, message.mid, message.qos, message.retain, self.connection
            )
        ])  # fmt: skip

    def _put(self, received_messages: list[ReceivedMessage]) -> None:
        if not self.accepting:
            return
        taken = self._receive_queue.put(received_messages)
        if taken < len(received_messages):
            # The nodes send them again; kept, they would clog the broker's window.
            self._release(received_messages[taken:])
