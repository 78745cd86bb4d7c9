"""One message as the broker delivered it."""

from __future__ import annotations

from typing import NamedTuple


class ReceivedMessage(NamedTuple):
    """One message as the broker delivered it; a tuple, because there are many.

    Attributes:
        topic: Where it arrived.
        payload: The sealed bytes, not yet trusted.
        mid: The broker's packet identifier, for the PUBACK.
        qos: MQTT quality of service, 0 or 1.
        retained: Whether the broker had kept it; then it is no sign of life.
        connection: Which connection it came over; a PUBACK is good only there.
    """

    topic: str
    payload: bytes
    mid: int
    qos: int
    retained: bool
    connection: int
