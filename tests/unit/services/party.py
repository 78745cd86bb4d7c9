"""An MQTT client with an identity, as an attacker or a guest would write it."""

from __future__ import annotations

import ssl
from typing import TYPE_CHECKING, Any, Self

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from eskin.identity import client_context
from tests.support.processes import wait_until

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.identity import Identity


class Party:
    """One connection.

    Attributes:
        heard: Topic and payload of all messages that reached it.
        connected: Whether the broker took it and has not dropped it since.
        refused: Whether the broker ended the connection.
    """

    def __init__(
        self,
        identity: Identity | None,
        port: int,
        *,
        root: Path,
        client_id: str | None = None,
        will: str | None = None,
    ) -> None:
        self.heard: list[tuple[str, bytes]] = []
        self.connected = False
        self.refused = False
        self._settled: set[int] = set()
        if client_id is None:
            client_id = "" if identity is None else identity.name
        self._client = paho.Client(
            CallbackAPIVersion.VERSION2, client_id=client_id, reconnect_on_failure=False
        )
        self._client.tls_set_context(client_context(root, identity))
        self._client.on_connect = self._on_connect
        self._client.on_disconnect = self._on_disconnect
        self._client.on_message = self._on_message
        self._client.on_subscribe = lambda *given: self._settled.add(given[2])
        self._client.on_publish = lambda *given: self._settled.add(given[2])
        if will is not None:
            self._client.will_set(will, b"will", qos=1)
        self._port = port

    def __enter__(self) -> Self:
        try:
            self._client.connect("127.0.0.1", self._port)
        except (ssl.SSLError, ConnectionError):
            self.refused = True
            return self
        self._client.loop_start()
        wait_until(lambda: self.connected or self.refused, "the broker answers")
        return self

    def __exit__(self, *_: object) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def subscribe(self, topic: str) -> Self:
        """Subscribe, and wait for the broker's answer."""
        self._settle(self._client.subscribe(topic, qos=1)[1])
        return self

    def publish(self, topic: str, payload: bytes) -> None:
        """Publish, and wait for the broker's acknowledgement, which the refused get too."""
        self._settle(self._client.publish(topic, payload, qos=1).mid)

    def break_off(self) -> None:
        """Lose the connection without a word."""
        own = self._client.socket()
        assert own is not None
        own.close()

    def _settle(self, number: int | None) -> None:
        wait_until(lambda: number in self._settled, "the broker acknowledges")

    def _on_connect(self, client: Any, userdata: Any, flags: Any, code: Any, *_: Any) -> None:
        del client, userdata, flags
        self.connected = not code.is_failure
        self.refused = code.is_failure

    def _on_disconnect(self, *_: Any) -> None:
        self.connected = False
        self.refused = True

    def _on_message(self, client: Any, userdata: Any, message: paho.MQTTMessage) -> None:
        del client, userdata
        self.heard.append((message.topic, bytes(message.payload)))
