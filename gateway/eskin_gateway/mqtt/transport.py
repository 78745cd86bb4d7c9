"""The seam to the MQTT broker."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from eskin_gateway.mqtt.received_message import ReceivedMessage


Publication: TypeAlias = tuple[str, bytes, bool]
"""Topic, payload, and whether the broker keeps it."""


class Transport(Protocol):
    """What the gateway needs of a broker, once arrivals come into the inbox."""

    @property
    def connected(self) -> bool:
        """Whether messages can come and go now."""

    def acknowledge(self, received_messages: Sequence[ReceivedMessage]) -> None:
        """Tell the broker that it may forget messages (PUBACK)."""

    def publish(self, publications: Iterable[Publication]) -> None:
        """Publish at QoS 0: topic, payload, whether the broker keeps it (retain).

        Whatever is lost on the way is said again: an acknowledgement when the node sends again.
        """
