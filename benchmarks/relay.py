"""What the gateway is measured beside: ``python -m benchmarks.relay PKI PORT PEER COUNT``.

PEER ``relay`` reads what nodes say and publishes it again at QoS 1, as plainly as paho allows:
nothing is checked, stored, forwarded or acknowledged. ``subscriber`` only reads. Both write a line
when they are subscribed, and one when COUNT messages are done.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any, Final

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from eskin.identity import Identity, client_context
from eskin.identity.identity import ROOT_FILE
from eskin.wire.topics import Stream, live_topic, node_topic

NAME: Final = "gateway.relay"
_INFLIGHT: Final = 1000
_TARGET: Final = live_topic("relay", "t01.capacitance")


class Relay:
    """paho's own thread and callbacks."""

    def __init__(self, pki: Path, port: int, *, publishes: bool, messages: int) -> None:
        self._left = messages
        identity = Identity.load(pki / NAME)
        client = mqtt.Client(CallbackAPIVersion.VERSION2, client_id=NAME)
        client.tls_set_context(client_context(identity.directory / ROOT_FILE, identity))
        client.max_inflight_messages_set(_INFLIGHT)
        client.on_connect = self._on_connect
        client.on_subscribe = self._on_subscribe
        if publishes:
            client.on_message = self._relay
            client.on_publish = self._on_publish
        else:
            client.on_message = self._read
        client.connect("127.0.0.1", port)
        client.loop_forever()

    def _on_connect(self, client: mqtt.Client, *_: Any) -> None:
        client.subscribe(node_topic("+", Stream.FRAMES), qos=1)

    def _on_subscribe(self, *_: Any) -> None:
        say("subscribed")

    def _relay(self, client: mqtt.Client, _: object, message: mqtt.MQTTMessage) -> None:
        client.publish(_TARGET, message.payload, qos=1)

    def _on_publish(self, client: mqtt.Client, *_: Any) -> None:
        del client
        self._count()

    def _read(self, client: mqtt.Client, _: object, message: mqtt.MQTTMessage) -> None:
        del client, message
        self._count()

    def _count(self) -> None:
        self._left -= 1
        if self._left == 0:
            say(f"done {time.time_ns()}")


def say(line: str) -> None:
    """Write a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    Relay(
        Path(sys.argv[1]),
        int(sys.argv[2]),
        publishes=sys.argv[3] == "relay",
        messages=int(sys.argv[4]),
    )
