"""What the broker does not read fills no memory."""

from __future__ import annotations

import ssl
from random import Random
from typing import TYPE_CHECKING

import paho.mqtt.client as paho
import pytest

from eskin.envelope import MOST_ENVELOPE
from gateway.backoff import Backoff
from gateway.inbox import Inbox
from gateway.mqtt import MqttBroker
from gateway.settings import BrokerSection

if TYPE_CHECKING:
    from collections.abc import Iterator

_MEBIBYTE = 1 << 20


@pytest.fixture
def broker(monkeypatch: pytest.MonkeyPatch) -> Iterator[MqttBroker]:
    """One that says that it is connected."""
    made = MqttBroker(
        BrokerSection(),
        name="gateway.g1",
        context=ssl.create_default_context(),
        inbox=Inbox(16, most_bytes=_MEBIBYTE),
        backoff=Backoff(1.0, 1.0, random=Random(1)),  # noqa: S311 - a pause, no secret
    )
    monkeypatch.setattr(made, "_subscribed", True)
    yield made
    made._wake_in.close()
    made._wake_out.close()


def test_publications_that_nobody_reads_are_bounded_in_bytes(broker: MqttBroker) -> None:
    broker.publish([("t", bytes(_MEBIBYTE), False)] * 40)
    assert len(broker._outgoing) == 32
    assert broker.dropped == 8


def test_nothing_is_handed_over_while_the_broker_does_not_read(
    broker: MqttBroker, monkeypatch: pytest.MonkeyPatch
) -> None:
    client, given, reads = broker._client, list[int](), iter((False, False, True, True, True))
    turns = iter(range(2))
    monkeypatch.setattr(client, "socket", lambda: next(turns, None))
    monkeypatch.setattr(client, "want_write", lambda: not next(reads))
    monkeypatch.setattr(client, "loop_write", lambda: given.append(-1))
    monkeypatch.setattr(client, "loop_misc", lambda: 0)
    monkeypatch.setattr(client, "publish", lambda _topic, payload, **_: given.append(len(payload)))
    monkeypatch.setattr(broker, "_wait", lambda *_, **__: None)
    monkeypatch.setattr(broker, "_read", lambda _: False)
    broker.publish([("t", bytes(7), False)])
    broker._serve()
    assert given == [-1, 7]


def test_message_that_is_too_long_takes_no_more_than_the_longest(broker: MqttBroker) -> None:
    message = paho.MQTTMessage(topic=b"eskin/v1/nodes/palm/blocks")
    message.payload = bytes(10 * MOST_ENVELOPE)
    broker._on_message(broker._client, None, message)
    (arrival,) = broker._inbox.take(1, linger_s=0, wait_s=0)
    assert len(arrival.payload) == MOST_ENVELOPE + 1
