"""The two packets in masses are written as paho does."""

from __future__ import annotations

import socket
import struct
from unittest.mock import Mock

from eskin_gateway.mqtt.mqtt_transport import (
    write_acknowledgements,
    write_publication,
)
from hypothesis import given
from hypothesis import strategies as st
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

VERSIONS = {False: MQTTProtocolVersion.MQTTv311, True: MQTTProtocolVersion.MQTTv5}
TOPICS = st.text(st.characters(codec="utf-8", exclude_characters="+#\0"), min_size=1, max_size=40)


def published(topic: str, payload: bytes, *, mid: int, qos: int, retain: bool, v5: bool) -> bytes:
    """A packet as paho writes it."""
    client = Client(CallbackAPIVersion.VERSION2, protocol=VERSIONS[v5])
    client._sock = Mock(spec=socket.socket)  # it sends nothing, but wants one
    client.on_socket_register_write = lambda *_: None
    client._send_publish(mid, topic.encode(), payload, qos, retain)
    return bytes(client._out_packet.popleft()["packet"])


@given(
    topic=TOPICS,
    payload=st.binary(max_size=300) | st.sampled_from([bytes(20_000), bytes(2_097_200)]),
    retain=st.booleans(),
    v5=st.booleans(),
)
def test_publication_is_written_as_paho_does(
    *, topic: str, payload: bytes, retain: bool, v5: bool
) -> None:
    packet = published(topic, payload, mid=0, qos=0, retain=retain, v5=v5)
    assert write_publication(topic, payload, retain=retain, v5=v5) == packet


def test_acknowledgements_are_concatenated() -> None:
    written = write_acknowledgements([1, 65_535])
    assert list(struct.iter_unpack(">BBH", written)) == [(0x40, 2, 1), (0x40, 2, 65_535)]
