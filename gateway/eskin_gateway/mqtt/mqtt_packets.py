"""The packets of MQTT that come and go in masses: PUBLISH and PUBACK (3.1.1, sections 3.3 and 3.4).

Version 5 adds a list of properties to them (its sections 3.3.2.3 and 3.4.2.2), which is empty here.
All other packets, and each of these that is not as most are, are paho's.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable

_PUBLISH: Final = 0x30
_QOS_2: Final = 0x04
_RETAIN: Final = 0x01
_LEAST: Final = 6
"""Remaining length of the least PUBLISH at QoS 1: a topic of one letter, an identifier."""
_PUBACK: Final = struct.Struct(">HH")
_ACKNOWLEDGED: Final = 0x4002
"""Type and remaining length of a PUBACK."""


class Publish(NamedTuple):
    """A PUBLISH; a tuple, because there are many.

    Attributes:
        end: Where the next packet begins.
        topic: Where it was published.
        payload: What was.
        mid: Its identifier; 0 at QoS 0.
        qos: 0 or 1.
        retained: Whether the broker had kept it.
    """

    end: int
    topic: str
    payload: bytes
    mid: int
    qos: int
    retained: bool


def read_publication(data: bytes, at: int, *, five: bool) -> Publish | None:
    """Read the packet at a place, if it is an ordinary PUBLISH of QoS 0 or 1 and whole.

    Args:
        data: What the broker sent.
        at: Where a packet begins.
        five: Whether version 5 is spoken.
    """
    if len(data) < at + 5 or data[at] & (0xF0 | _QOS_2) != _PUBLISH:
        return None
    length, start = data[at + 1], at + 2
    if length > 127:  # three bytes hold two million, more than any message has
        length, start = length + (data[start] << 7) - 128, start + 1
        if length > 16_383:
            length, start = length + (data[start] << 14) - 16_384, start + 1
    end = start + length
    if length < _LEAST or end > len(data) or length > 2_097_151:
        return None
    qos = data[at] >> 1 & 1
    named = start + 2 + (data[start] << 8 | data[start + 1])
    body = named + 2 * qos + five
    if named == start + 2 or body > end or (five and data[body - 1]):
        return None
    topic = _topic(data[start + 2 : named])
    if topic is None:
        return None
    mid = data[named] << 8 | data[named + 1] if qos else 0
    return Publish(end, topic, data[body:end], mid, qos, bool(data[at] & _RETAIN))


@lru_cache(4096)
def _topic(raw: bytes) -> str | None:
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return None


def write_publication(topic: str, payload: bytes, *, retain: bool, five: bool) -> bytes:
    """Write a PUBLISH at QoS 0."""
    named = _named(topic, five=five)
    return b"%b%b%b" % (_head(_PUBLISH | retain, len(named) + len(payload)), named, payload)


@lru_cache(16_384)
def _named(topic: str, *, five: bool) -> bytes:
    """What stands before the payload: topic, and no properties."""
    name = topic.encode()
    return b"%b%b%b" % (len(name).to_bytes(2), name, bytes(five))


@lru_cache(4096)
def _head(kind: int, length: int) -> bytes:
    """The fixed header (section 2.2)."""
    head = bytearray((kind,))
    while length > 127:
        head.append(length & 127 | 128)
        length >>= 7
    head.append(length)
    return bytes(head)


def write_acknowledgements(mids: Iterable[int]) -> bytes:
    """Write a PUBACK for each identifier."""
    return b"".join([_PUBACK.pack(_ACKNOWLEDGED, mid) for mid in mids])
