"""paho's client with one write for many messages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import paho.mqtt.client as mqtt

if TYPE_CHECKING:
    from collections.abc import Iterable

_PUBLISH: Final = 0x30
_RETAIN: Final = 0x01


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
