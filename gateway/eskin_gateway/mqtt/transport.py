"""Messages from and to the MQTT broker, and the connection that the gateway needs."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


class ReceivedMessage(NamedTuple):
    """A PUBLISH from the broker. A tuple, because there are many.

    Attributes:
        topic: MQTT topic.
        payload: Sealed bytes, not yet trusted.
        mid: Packet identifier, for the PUBACK.
        qos: MQTT quality of service, 0 or 1.
        retained: Whether the broker sent a retained message. It does not show that the node is
            online.
        connection: Number of the connection. A PUBACK is valid on this one only.
    """

    topic: str
    payload: bytes
    mid: int
    qos: int
    retained: bool
    connection: int


Publication: TypeAlias = tuple[str, bytes, bool]
"""Topic, payload and retain flag."""


class Transport(Protocol):
    """A connection to the MQTT broker. Received messages go to the receive queue."""

    @property
    def connected(self) -> bool:
        """Whether the subscriptions are active."""

    def acknowledge(self, received_messages: Sequence[ReceivedMessage]) -> None:
        """Send PUBACKs, so that the broker drops the messages."""

    def publish(self, publications: Iterable[Publication]) -> None:
        """Publish at QoS 0.

        A lost publication is sent again: an acknowledgement when the node retries its message.
        """
