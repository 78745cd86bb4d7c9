"""Writes the two frequent MQTT packets: PUBLISH and PUBACK (MQTT 3.1.1, sections 3.3 and 3.4).

Version 5 adds a list of properties to them (its sections 3.3.2.3 and 3.4.2.2), which is empty here.
paho writes all other packets, and reads all.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterable

_PUBLISH: Final = 0x30
_PUBACK: Final = struct.Struct(">HH")
_ACKNOWLEDGED: Final = 0x4002
"""Type and remaining length of a PUBACK."""


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
