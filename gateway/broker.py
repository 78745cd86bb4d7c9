"""The seam to the MQTT broker."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from gateway.arrival import Arrival


class Broker(Protocol):
    """What the gateway needs of a broker, once arrivals come into the inbox."""

    @property
    def connected(self) -> bool:
        """Whether messages can come and go now."""

    def acknowledge(self, arrivals: Sequence[Arrival]) -> None:
        """Tell the broker that it may forget messages (PUBACK)."""

    def publish(self, publications: Iterable[tuple[str, bytes, bool]]) -> None:
        """Publish at QoS 0: topic, payload, whether the broker keeps it (retain).

        Whatever is lost on the way is said again: an acknowledgement when the node sends again.
        """
