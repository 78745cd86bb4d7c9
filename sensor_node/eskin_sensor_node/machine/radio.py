"""The emulated radio link to the access point: bandwidth, packet loss, byte counts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np

    from eskin_sensor_node.settings import RadioSection


class Meter(Protocol):
    """Counts bytes, for the energy account.

    Attributes:
        sent: Bytes, with repeats.
        received: Bytes.
    """

    sent: int
    received: int


class Radio:
    """Sends one message after the other, packet by packet, in emulated time.

    A packet that is lost has cost its time and its energy, and is repeated at once. After so many
    tries the radio drops the message, and the outbox sends it again. What comes to the
    node is repeated by the access point, and costs the node the last try only.

    Args:
        settings: Bandwidth, loss, and how packets are made.
        now: Emulated ns.
        random: Decides which packets are lost: the n-th of a boot, whatever is in it.
        meter: Takes the counts.
        speed: Emulated seconds in a real one.
    """

    def __init__(
        self,
        settings: RadioSection,
        *,
        now: Callable[[], int],
        random: np.random.Generator,
        meter: Meter,
        speed: float = 1.0,
    ) -> None:
        self._settings = settings
        self._now = now
        self._random = random
        self._meter = meter
        self._speed = speed
        self._busy_until = 0

    def is_free(self, within_s: float = 0.0) -> bool:
        """Whether all is sent by an instant so many real seconds from now."""
        return self._busy_until <= self._now() + round(within_s * self._speed * BILLION)

    def has_reached(self, instant: int) -> bool:
        """Whether an emulated instant has come."""
        return instant <= self._now()

    def send(self, size: int) -> tuple[int, bool]:
        """Send a message behind those that are being sent.

        Args:
            size: Its bytes.

        Returns:
            The emulated instant, ns, at which it is over, and whether all of it arrived.
        """
        aired, arrived = self._air(size)
        self._meter.sent += aired
        self._busy_until = max(self._busy_until, self._now()) + self._duration(aired)
        return self._busy_until, arrived

    def receive(self, size: int) -> None:
        """Take bytes from the air."""
        self._meter.received += size

    def _air(self, size: int) -> tuple[int, bool]:
        """Bytes on the air until a message arrived, or was given up."""
        aired = 0
        while size > 0:
            packet = min(size, self._settings.packet_bytes)
            size -= packet
            for _ in range(self._settings.tries):
                aired += packet
                if not self._is_lost():
                    break
            else:
                return aired, False
        return aired, True

    def _is_lost(self) -> bool:
        return self._settings.loss > 0.0 and self._random.random() < self._settings.loss

    def _duration(self, size: int) -> int:
        bandwidth = self._settings.bandwidth_bytes_per_s
        return 0 if bandwidth is None else -(-size * BILLION // bandwidth)
