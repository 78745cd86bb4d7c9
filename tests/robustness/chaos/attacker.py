"""``python -m tests.robustness.chaos.attacker PORT repeat|flood``: an attacker at the broker.

They can read and write every topic, and hold no key of others.
"""

from __future__ import annotations

import os
import random
import sys
import time
from typing import Any, Final

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.subscribeoptions import SubscribeOptions

_SEALED: Final = "eskin/v1/nodes/#"
_COPIES: Final = 3
_KEPT: Final = 200
_RUBBISH: Final = 5000
_PAUSE_S: Final = 0.2


def main() -> None:
    """Repeat until killed, or flood and end."""
    port, deed = int(sys.argv[1]), sys.argv[2]
    client = paho.Client(CallbackAPIVersion.VERSION2, protocol=MQTTProtocolVersion.MQTTv5)
    heard: list[tuple[str, bytes]] = []

    def hear(_client: paho.Client, _data: Any, message: paho.MQTTMessage) -> None:
        heard.append((message.topic, bytes(message.payload)))
        del heard[:-_KEPT]

    client.on_message = hear
    client.connect("127.0.0.1", port)
    client.loop_start()
    if deed == "flood":
        _flood(client)
    else:
        # noLocal: it does not receive its own messages.
        client.subscribe(_SEALED, options=SubscribeOptions(qos=0, noLocal=True))
        _repeat(client, heard)


def _flood(client: paho.Client) -> None:
    for number in range(_RUBBISH):
        stream = ("frames", "events", "status")[number % 3]
        client.publish(f"eskin/v1/nodes/outsider-{number % 50}/{stream}", os.urandom(2000), qos=1)
    while client.is_connected() and client.want_write():
        time.sleep(_PAUSE_S)


def _repeat(client: paho.Client, heard: list[tuple[str, bytes]]) -> None:
    draw = random.Random(1)  # noqa: S311 - an order, no secret
    while True:
        time.sleep(_PAUSE_S)
        said = heard * _COPIES
        draw.shuffle(said)
        for topic, payload in said:
            client.publish(topic, payload, qos=0)


if __name__ == "__main__":
    main()
