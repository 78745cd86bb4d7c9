"""Our reading and writing of the two packets in masses agrees with paho's."""

from __future__ import annotations

import socket
import struct
from unittest.mock import Mock

import pytest
from eskin_gateway.mqtt.mqtt_packets import (
    read_publication,
    write_acknowledgements,
    write_publication,
)
from eskin_gateway.mqtt.transport import ReceivedMessage
from hypothesis import given
from hypothesis import strategies as st
from paho.mqtt._packet import decode_publish
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.exception import MalformedPacket

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
    payload=st.binary(max_size=300) | st.sampled_from([bytes(20_000), bytes(2_097_000)]),
    mid=st.integers(1, 65_535),
    qos=st.sampled_from([0, 1]),
    retain=st.booleans(),
    v5=st.booleans(),
    before=st.binary(max_size=9),
)
def test_ordinary_publication_is_read_and_written_as_paho_does(
    *, topic: str, payload: bytes, mid: int, qos: int, retain: bool, v5: bool, before: bytes
) -> None:
    packet = published(topic, payload, mid=mid, qos=qos, retain=retain, v5=v5)
    data = before + packet
    read = read_publication(data + b"more", len(before), connection=3, v5=v5)
    found = mid if qos else 0
    message = ReceivedMessage(topic, payload, found, qos, retain, connection=3)
    assert read in {None, (len(data), message)}
    assert read is not None or len(packet) < 10
    if qos == 0:
        assert write_publication(topic, payload, retain=retain, v5=v5) == packet


@given(data=st.binary(max_size=40), v5=st.booleans(), kind=st.sampled_from([0x30, 0x32, 0x33]))
def test_any_bytes_are_read_as_paho_does(*, data: bytes, v5: bool, kind: int) -> None:
    packet = bytes((kind, len(data))) + data
    read = read_publication(packet, 0, connection=3, v5=v5)
    try:
        theirs = decode_publish(kind, data, VERSIONS[v5])
    except MalformedPacket:
        assert read is None
        return
    if read is not None:
        end, ours = read
        assert end == len(packet)
        assert ours.topic.encode() == theirs.topic
        assert (ours.payload, ours.mid, ours.qos) == (theirs.payload, theirs.mid, theirs.qos)
        assert ours.retained == theirs.retain


@pytest.mark.parametrize("cut", range(1, 24))
def test_incomplete_publication_is_not_read(cut: int) -> None:
    packet = published("a/topic", b"payload", mid=9, qos=1, retain=False, v5=False)
    assert read_publication(packet, 0, connection=3, v5=False) is not None
    assert read_publication(packet[:-cut], 0, connection=3, v5=False) is None


def test_other_packets_qos_2_properties_and_no_topic_are_left_to_paho() -> None:
    assert read_publication(bytes.fromhex("d000") * 9, 0, connection=3, v5=False) is None
    assert read_publication(b"\x34\x09\x00\x01t\x00\x01body", 0, connection=3, v5=False) is None
    aliased = b"\x32\x0a\x00\x01t\x00\x01\x03\x23\x00\x01b"
    assert read_publication(aliased, 0, connection=3, v5=True) is None
    assert read_publication(b"\x32\x09\x00\x00\x00\x01\x00body", 0, connection=3, v5=True) is None
    assert read_publication(b"\x32\x09\x00\x01\xff\x00\x01body", 0, connection=3, v5=False) is None
    longest = published("t", bytes(2_097_200), mid=1, qos=1, retain=False, v5=False)
    assert read_publication(longest + bytes(3_000_000), 0, connection=3, v5=False) is None


def test_acknowledgements_are_concatenated() -> None:
    written = write_acknowledgements([1, 65_535])
    assert list(struct.iter_unpack(">BBH", written)) == [(0x40, 2, 1), (0x40, 2, 65_535)]
