"""The two frequent MQTT packets: PUBLISH and PUBACK (MQTT 3.1.1, sections 3.3 and 3.4).

Version 5 adds a list of properties to them (its sections 3.3.2.3 and 3.4.2.2), which is empty here.
paho handles all other packets, and unusual ones of these two.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import TYPE_CHECKING, Final

from eskin_gateway.mqtt.transport import ReceivedMessage

if TYPE_CHECKING:
    from collections.abc import Iterable

_PUBLISH: Final = 0x30
_QOS_2: Final = 0x04
_RETAIN: Final = 0x01
_MIN_LENGTH: Final = 6
"""Remaining length of the shortest PUBLISH at QoS 1: a topic of one letter, an identifier."""
_PUBACK: Final = struct.Struct(">HH")
_ACKNOWLEDGED: Final = 0x4002
"""Type and remaining length of a PUBACK."""


def read_publication(
    data: bytes, at: int, *, connection: int, v5: bool
) -> tuple[int, ReceivedMessage] | None:
    """Read a packet if it is complete and an ordinary PUBLISH of QoS 0 or 1.

    Returns:
        The offset of the next packet, and the message.

    Args:
        data: Bytes from the broker.
        at: Offset of the packet.
        connection: Number of the connection.
        v5: Whether the protocol is version 5.
    """
    if len(data) < at + 5 or data[at] & (0xF0 | _QOS_2) != _PUBLISH:
        return None
    length, start = data[at + 1], at + 2
    if length > 127:  # three bytes reach two million, more than any message has
        length, start = length + (data[start] << 7) - 128, start + 1
        if length > 16_383:
            length, start = length + (data[start] << 14) - 16_384, start + 1
    end = start + length
    if length < _MIN_LENGTH or end > len(data) or length > 2_097_151:
        return None
    qos = data[at] >> 1 & 1
    topic_end = start + 2 + (data[start] << 8 | data[start + 1])
    body = topic_end + 2 * qos + v5
    if topic_end == start + 2 or body > end or (v5 and data[body - 1]):
        return None
    topic = _topic(data[start + 2 : topic_end])
    if topic is None:
        return None
    mid = data[topic_end] << 8 | data[topic_end + 1] if qos else 0
    retained = bool(data[at] & _RETAIN)
    return end, ReceivedMessage(topic, data[body:end], mid, qos, retained, connection)


@lru_cache(4096)
def _topic(raw: bytes) -> str | None:
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return None


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
