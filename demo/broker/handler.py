"""One connection's packets, as amqtt reads and answers them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from amqtt.mqtt.protocol.broker_handler import BrokerProtocolHandler

if TYPE_CHECKING:
    from collections.abc import Callable

    from amqtt.mqtt.publish import PublishPacket


class Handler(BrokerProtocolHandler):  # type: ignore[misc]  # amqtt ships no types
    """Drops what nobody has subscribed to where it comes in.

    A gateway publishes for other clients whether or not there are any, and each message costs amqtt
    two queues and five tasks.

    Attributes:
        is_heard: Whether somebody has subscribed to a topic.
    """

    is_heard: Callable[[str], bool]

    async def handle_publish(self, publish_packet: PublishPacket) -> None:
        """Take a message in, unless it is of QoS 0, not to be kept, and for nobody."""
        kept = publish_packet.qos or publish_packet.retain_flag
        if kept or self.is_heard(publish_packet.topic_name):
            await super().handle_publish(publish_packet)
