"""Bytes on the air for each message, as its envelope, MQTT and TLS wrap it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin_sensor_node.machine.prices import ENVELOPE

if TYPE_CHECKING:
    from eskin_sensor_node.firmware.chip import StoredMessage

_TRANSPORT: Final = 80
"""MQTT's PUBLISH with its topic, and a TLS record."""
_ANSWER: Final = 40
"""PUBACK in a TLS record, and a share of the gateway's acknowledgement of many messages."""


def sent_for(kept: StoredMessage) -> int:
    """Bytes sent for a message that needs no repeat."""
    return len(kept.body) + ENVELOPE + _TRANSPORT


def received_for(kept: StoredMessage) -> int:
    """Bytes received for a message."""
    del kept
    return _ANSWER
