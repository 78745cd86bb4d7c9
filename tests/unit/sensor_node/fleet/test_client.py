"""Many messages in one write are the messages that paho would send one by one."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING

import paho.mqtt.client as mqtt
from eskin_sensor_node.fleet.connection import BundlingClient
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st
from paho.mqtt.enums import CallbackAPIVersion

if TYPE_CHECKING:
    from collections.abc import Sequence

TOPICS = st.text("abcdefgh/é", min_size=1, max_size=150)
MESSAGES = st.lists(st.tuples(TOPICS, st.integers(0, 17_000).map(bytes), st.booleans()), max_size=4)


def on_message(messages: Sequence[tuple[str, bytes, bool]], *, together: bool) -> bytes:
    """What arrives at the other end of a connection."""
    near, far = socket.socketpair()
    with near, far:
        near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
        client = BundlingClient(CallbackAPIVersion.VERSION2)
        client._sock = near
        if together:
            client.publish_together(messages)
        else:
            for topic, payload, retained in messages:
                info = mqtt.Client.publish(client, topic, payload, qos=0, retain=retained)
                assert info.rc == mqtt.MQTT_ERR_SUCCESS
        client._sock = None
        near.shutdown(socket.SHUT_WR)
        found = b""
        while piece := far.recv(1 << 20):
            found += piece
        return found


@effort(deadline=None, max_examples=50)
@given(MESSAGES)
def test_together_is_what_one_by_one_is(messages: list[tuple[str, bytes, bool]]) -> None:
    assert on_message(messages, together=True) == on_message(messages, together=False)
