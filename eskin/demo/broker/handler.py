"""One connection's packets, as amqtt reads and answers them."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final, Self

from amqtt.mqtt.connect import ConnectPacket
from amqtt.mqtt.packet import MQTTFixedHeader
from amqtt.mqtt.protocol import handler as amqtt_handler
from amqtt.mqtt.protocol.broker_handler import BrokerProtocolHandler

from eskin.wire.envelope import MOST_ENVELOPE

if TYPE_CHECKING:
    from collections.abc import Callable

    from amqtt.adapters import ReaderAdapter
    from amqtt.mqtt.publish import PublishPacket

log = logging.getLogger(__name__)

MOST_REMAINING: Final = MOST_ENVELOPE + 2 + 65_535 + 2
"""Greatest remaining length of a packet, in bytes: the largest envelope, the longest topic with its
length, and a packet identifier (MQTT 3.1.1, sections 2.2.3 and 3.3)."""


class FixedHeader(MQTTFixedHeader):  # type: ignore[misc]  # amqtt ships no types
    """A fixed header whose remaining length is checked before any of the body is read.

    amqtt takes up to 256 MB, and keeps what has arrived for as long as the client sends no more.
    """

    @classmethod
    async def from_stream(cls, reader: ReaderAdapter) -> Self | None:
        """Read a fixed header; ``None`` where the stream ends, or the packet is too large.

        amqtt closes the connection in both cases; after an `MQTTError` it would read on.
        """
        header: Self | None = await super().from_stream(reader)
        if header is not None and header.remaining_length > MOST_REMAINING:
            log.warning(
                "packet too large: bytes=%d most=%d", header.remaining_length, MOST_REMAINING
            )
            return None
        return header


# amqtt has no other place where the check can go: its loop over packets names the class itself.
amqtt_handler.MQTTFixedHeader = FixedHeader
ConnectPacket.FIXED_HEADER = FixedHeader


class Handler(BrokerProtocolHandler):  # type: ignore[misc]  # amqtt ships no types
    """Drops messages without a subscriber on arrival.

    A gateway publishes for other clients whether or not there are any, and each message costs amqtt
    two queues and five tasks.

    Attributes:
        is_heard: Whether a client has subscribed to a topic.
    """

    is_heard: Callable[[str], bool]

    async def handle_publish(self, publish_packet: PublishPacket) -> None:
        """Accept a message, unless it is of QoS 0, not retained, and without a subscriber."""
        kept = publish_packet.qos or publish_packet.retain_flag
        if kept or self.is_heard(publish_packet.topic_name):
            await super().handle_publish(publish_packet)
