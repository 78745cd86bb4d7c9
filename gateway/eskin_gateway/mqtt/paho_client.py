"""paho's client, tuned for many messages and one receiver."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from eskin.runtime.nodelay import send_at_once

if TYPE_CHECKING:
    from collections.abc import Callable


class PahoClient(paho.Client):
    """Hands each message to one receiver.

    paho looks for receivers by topic, under two locks: a third of what reading a message costs.

    Args:
        take: The receiver.
        options: As paho's.
    """

    def __init__(self, *, take: Callable[[paho.MQTTMessage], None], **options: Any) -> None:
        super().__init__(CallbackAPIVersion.VERSION2, **options)
        self._take = take
        self.on_socket_open = send_at_once

    def _handle_on_message(self, message: paho.MQTTMessage) -> None:
        self._take(message)

    @property
    def between_packets(self) -> bool:
        """Whether it has read no part of a packet whose rest is still to come."""
        return self._in_packet["command"] == 0
