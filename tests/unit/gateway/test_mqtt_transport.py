"""Memory stays bounded while the broker does not read."""

from __future__ import annotations

import ssl
from random import Random
from types import SimpleNamespace
from typing import TYPE_CHECKING
from unittest.mock import Mock

import paho.mqtt.client as paho
import pytest
from eskin_gateway.mqtt.buffered_socket import BufferedSocket
from eskin_gateway.mqtt.mqtt_transport import MqttTransport
from eskin_gateway.mqtt.receive_queue import ReceiveQueue
from eskin_gateway.mqtt.transport import ReceivedMessage
from eskin_gateway.settings import BrokerSection

from eskin.runtime.supervised import Backoff
from eskin.wire.envelope import MOST_ENVELOPE

if TYPE_CHECKING:
    from collections.abc import Iterator

_MEBIBYTE = 1 << 20


@pytest.fixture
def broker(monkeypatch: pytest.MonkeyPatch) -> Iterator[MqttTransport]:
    """A transport that counts as connected."""
    made = MqttTransport(
        BrokerSection(),
        name="gateway.g1",
        context=ssl.create_default_context(),
        receive_queue=ReceiveQueue(16, most_bytes=_MEBIBYTE),
        on_alarm=lambda *_: None,
        backoff=Backoff(1.0, 1.0, random=Random(1)),  # noqa: S311 - a pause, no secret
    )
    monkeypatch.setattr(made, "_subscribed", True)
    yield made
    made._wake_in.close()
    made._wake_out.close()


def test_unread_publications_are_bounded_in_bytes(broker: MqttTransport) -> None:
    broker.publish([("t", bytes(_MEBIBYTE), False)] * 40)
    assert len(broker._send_queue) == 32
    assert broker.dropped == 8


def test_nothing_is_written_while_the_broker_is_congested(broker: MqttTransport) -> None:
    broker.publish([("t", b"seven", False)])
    own = Mock(spec=BufferedSocket, congested=True)
    assert not broker._write(own)
    own.send.assert_not_called()
    own.congested = False
    assert not broker._write(own)
    own.send.assert_called_once_with(b"\x30\x08\x00\x01tseven")
    assert own.flush.call_count == 2


def test_holding_back_ends_after_half_a_keep_alive(
    broker: MqttTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [1000.0]
    monkeypatch.setattr(
        "eskin_gateway.mqtt.mqtt_transport.time", SimpleNamespace(monotonic=lambda: now[0])
    )

    def looks(pause: float, *, most: int = 10_000) -> int:
        """Number of checks until holding back ends."""
        for count in range(most):
            if not broker._is_holding_back():
                return count
            now[0] += pause
        return most

    assert looks(0.005) == 0, "there is room"
    broker._receive_queue.put([ReceivedMessage("t", b"", 7, 1, retained=False, connection=1)] * 16)
    assert looks(0.005, most=1000) == 1000
    assert 7.5 - 5.0 < looks(0.3) * 0.3 < 7.5 - 5.0 + 0.9, "half of 15 s, in all"
    (one, *_) = broker._receive_queue.take(1, linger_s=0, wait_s=0)
    assert not broker._is_holding_back(), "there is room"
    broker._receive_queue.put([one])
    now[0] += 0.3
    assert looks(0.3) * 0.3 > 7.0, "it begins anew"


def test_acknowledgement_of_an_earlier_connection_is_dropped(
    broker: MqttTransport,
) -> None:
    came = ReceivedMessage("t", b"", 7, 1, retained=False, connection=1)
    broker.connection = 2
    broker.acknowledge([came, came._replace(mid=8, connection=2), came._replace(qos=0)])
    own = Mock(spec=BufferedSocket, congested=False)
    assert not broker._write(own)
    own.send.assert_called_once_with(b"\x40\x02\x00\x08")


def test_oversized_message_is_truncated(broker: MqttTransport) -> None:
    message = paho.MQTTMessage(topic=b"eskin/v1/nodes/palm/frames")
    message.payload = bytes(10 * MOST_ENVELOPE)
    broker.receive(message)
    (received_message,) = broker._receive_queue.take(1, linger_s=0, wait_s=0)
    assert len(received_message.payload) == MOST_ENVELOPE + 1


def test_message_without_room_is_released_at_the_broker(broker: MqttTransport) -> None:
    message = paho.MQTTMessage(mid=9, topic=b"eskin/v1/nodes/palm/frames")
    message.qos = 1
    broker.connection = 1
    for _ in range(17):
        broker.receive(message)
    assert broker._receive_queue.statistics.depth == 16
    assert broker._receive_queue.statistics.dropped == 1
    own = Mock(spec=BufferedSocket, congested=False)
    assert not broker._write(own)
    own.send.assert_called_once_with(b"\x40\x02\x00\x09")
