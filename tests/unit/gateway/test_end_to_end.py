"""From node over broker and spool to cloud, acknowledgement and public topics."""

from __future__ import annotations

from typing import TYPE_CHECKING

import orjson
import pytest
from eskin_gateway.service import Gateway

from eskin.identity import IdentityKind
from eskin.wire.timestamp import format_timestamp
from eskin.wire.topics import Stream, live_topic
from tests.support.processes import wait_until
from tests.unit.gateway.messages import CHANNEL, EPOCH, frame, gap, peak, status
from tests.unit.gateway.skins import MIXED, TOUCHED, SkinNode, SkinOf
from tests.unit.gateway.wire_node import Listener, WireNode

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_gateway.settings import GatewaySettings

    from eskin.wire.frames import Frame
    from eskin.wire.messages import Status
    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities
    from tests.unit.gateway.stub_cloud import StubCloud


@pytest.fixture
def listener(identities: Identities, broker: Mosquitto) -> Iterator[Listener]:
    client = identities.make(IdentityKind.CLIENT, "client.demo")
    with Listener(client, broker.client_port) as listening:
        yield listening


def test_messages_reach_cloud_in_order_and_are_acknowledged(
    gateway: Gateway, cloud: StubCloud, node: WireNode
) -> None:
    said = [frame(number) for number in range(1, 40)]
    node.say(Stream.STATUS, status(0))
    for message in said:
        node.say(Stream.FRAMES, message)
    node.wait_for(*((1, number) for number in range(40)))
    wait_until(lambda: len(cloud.stored) == 40, "the cloud stored all")
    everything: list[Status | Frame] = [status(0), *said]
    assert cloud.stored == [("fingertip", message.encode()) for message in everything]
    wait_until(lambda: gateway.spool.statistics.messages == 0, "the spool is empty")
    assert gateway.metrics.value("messages_accepted_total") == 40
    assert node.times == sorted(node.times)


def test_duplicate_is_acknowledged_and_not_stored_again(
    gateway: Gateway, cloud: StubCloud, node: WireNode, listener: Listener
) -> None:
    node.say(Stream.STATUS, status(0))
    envelope = node.say(Stream.FRAMES, frame(1))
    node.wait_for((1, 0), (1, 1))
    node.acknowledged.clear()
    node.publish(Stream.FRAMES, envelope)
    node.wait_for((1, 1))
    node.say(Stream.FRAMES, frame(2))
    wait_until(lambda: len(cloud.stored) == 3, "the cloud stored what came after")

    def published() -> list[str]:
        hulls = listener.on(live_topic("fingertip", CHANNEL))
        return [orjson.loads(hull)["t0"] for hull in hulls]

    begins = [format_timestamp(EPOCH + number * 100 * 10**6) for number in (1, 2)]
    wait_until(lambda: begins[1] in published(), "what came after is public")
    assert published() == begins
    assert gateway.metrics.value("messages_duplicate_total") == 1
    assert cloud.duplicates == 0


@pytest.mark.usefixtures("gateway")
@pytest.mark.parametrize("skin", [MIXED, TOUCHED])
def test_biometric_channels_are_not_public(
    node: WireNode, listener: Listener, skin: SkinOf
) -> None:
    node.say(Stream.STATUS, status(0))
    SkinNode(node, skin).describe()
    node.say(Stream.FRAMES, skin.frame(1, page=1))
    node.say(Stream.EVENTS, skin.peaks(2, number=1))
    node.say(Stream.FRAMES, skin.frame(3))
    node.say(Stream.EVENTS, skin.peaks(4))
    events = live_topic("fingertip", "events")
    wait_until(lambda: bool(listener.on(events)), "the last event is public")
    assert [orjson.loads(item)["sequence"] for item in listener.on(events)] == [4]
    public, personal = (patch.channels[0] for patch in skin.patches)
    wait_until(lambda: bool(listener.on(live_topic("fingertip", public))), "the frame is public")
    assert listener.on(live_topic("fingertip", personal)) == []


@pytest.mark.usefixtures("gateway")
def test_public_topics_carry_hull_events_and_status(node: WireNode, listener: Listener) -> None:
    sent = frame(1)
    node.say(Stream.STATUS, status(0))
    node.say(Stream.FRAMES, sent)
    node.say(Stream.EVENTS, peak(2))
    node.say(Stream.EVENTS, gap(3))
    events = live_topic("fingertip", "events")
    wait_until(lambda: len(listener.on(events)) == 2, "both events are public")
    wait_until(lambda: bool(listener.on(live_topic("fingertip", CHANNEL))), "the frame is public")
    hull = orjson.loads(listener.on(live_topic("fingertip", CHANNEL))[0])
    (samples,) = sent.values
    assert (hull["lo"], hull["hi"]) == (samples.inf.min(), samples.sup.max())
    first, second = (orjson.loads(item) for item in listener.on(events))
    assert (first["kind"], first["verdict"], first["height"]) == (
        "peak",
        "possible",
        {"lo": 1e-11, "hi": None},
    )
    assert (second["kind"], second["channel"], second["sequence"]) == ("gap", None, 3)
    assert second["time"] == {"lo": format_timestamp(EPOCH), "hi": format_timestamp(EPOCH + 9)}


@pytest.mark.usefixtures("gateway")
def test_silent_node_is_published_as_offline(node: WireNode, listener: Listener) -> None:
    def online() -> list[bool]:
        return [orjson.loads(s)["online"] for s in listener.on(live_topic("fingertip", "status"))]

    node.say(Stream.STATUS, status(0))
    wait_until(lambda: len(online()) >= 2, "online, and offline after silence")
    node.say(Stream.FRAMES, frame(1))
    wait_until(lambda: len(online()) >= 3, "online again")
    assert online()[:3] == [True, False, True]


def test_retained_status_does_not_make_a_node_online(
    settings: GatewaySettings, node: WireNode, listener: Listener
) -> None:
    node.say(Stream.STATUS, status(0))
    node.wait_for_broker()
    running = Gateway(settings)
    running.start()
    topic = live_topic("fingertip", "status")
    wait_until(lambda: bool(listener.on(topic)), "the node's status is public")
    running.stop()
    assert [orjson.loads(item)["online"] for item in listener.on(topic)] == [False]


def test_restarted_gateway_opens_frames_before_the_next_status(
    settings: GatewaySettings, broker: Mosquitto, cloud: StubCloud, node: WireNode
) -> None:
    first = Gateway(settings)
    first.start()
    wait_until(lambda: first.broker.connected, "the gateway is connected")
    node.say(Stream.STATUS, status(0))
    node.say(Stream.FRAMES, frame(1))
    node.wait_for((1, 0), (1, 1))  # so it has the layout, too
    first.stop()
    broker.stop()
    (broker.log.parent / "mosquitto.db").unlink()  # it shall have forgotten the kept status
    broker.begin()
    second = Gateway(settings)
    second.start()
    wait_until(lambda: second.broker.connected, "the second gateway is connected")
    wait_until(lambda: node.ready, "the node is back")
    node.say(Stream.FRAMES, frame(2))
    node.wait_for((1, 2))
    wait_until(lambda: len(cloud.stored) == 3, "the cloud stored all")
    second.stop()


def test_gateway_that_starts_first_waits_for_broker_and_cloud(
    settings: GatewaySettings, broker: Mosquitto, cloud: StubCloud, identities: Identities
) -> None:
    broker.stop()
    cloud.end()
    running = Gateway(settings)
    running.start()
    wait_until(lambda: "cannot connect" in str(running.broker.fault), "it tried the broker")
    broker.begin()
    wait_until(lambda: running.broker.connected, "the gateway is connected")
    with WireNode(identities.node, identities.site, broker.node_port) as node:
        node.say(Stream.STATUS, status(0))
        node.wait_for((1, 0))
    wait_until(lambda: running.forwarder.reachable is False, "it tried the cloud")
    cloud.begin()
    wait_until(lambda: len(cloud.stored) == 1, "the cloud stored it")
    running.stop()


@pytest.mark.parametrize(("protocol", "group"), [("5", ""), ("5", "g"), ("3.1.1", "g")])
def test_other_protocols_and_shared_subscriptions_work(
    settings: GatewaySettings, node: WireNode, cloud: StubCloud, protocol: str, group: str
) -> None:
    section = settings.broker.model_copy(update={"protocol": protocol, "group": group})
    running = Gateway(settings.model_copy(update={"broker": section}))
    running.start()
    wait_until(lambda: running.broker.connected, "the gateway is connected")
    node.say(Stream.STATUS, status(0))
    for number in range(1, 50):
        node.say(Stream.FRAMES, frame(number))
    node.wait_for(*((1, number) for number in range(50)))
    wait_until(lambda: len(cloud.stored) == 50, "the cloud stored all")
    running.stop()


def test_unknown_sender_is_not_acknowledged_until_it_introduces_itself(
    gateway: Gateway, cloud: StubCloud, node: WireNode
) -> None:
    node.say(Stream.FRAMES, frame(0))
    wait_until(
        lambda: gateway.metrics.value("messages_rejected_total", reason="unknown_sender") == 1,
        "the frame is refused",
    )
    node.say(Stream.STATUS, status(1))
    node.wait_for((1, 1))
    assert (1, 0) not in node.acknowledged
    node.say(Stream.FRAMES, frame(0))
    node.wait_for((1, 0))
    wait_until(lambda: len(cloud.stored) == 2, "the cloud stored both")


def test_rejected_messages_do_not_fill_the_brokers_window(gateway: Gateway, node: WireNode) -> None:
    for _ in range(1500):  # more than the broker's window of 1000
        node.publish(Stream.FRAMES, b"rubbish")
    node.say(Stream.STATUS, status(0))
    node.wait_for((1, 0))
    assert gateway.metrics.value("messages_rejected_total", reason="malformed") == 1500


def test_stopped_gateway_acknowledges_what_it_accepted(
    settings: GatewaySettings, cloud: StubCloud, node: WireNode
) -> None:
    running = Gateway(settings)
    running.start()
    wait_until(lambda: running.broker.connected, "the gateway is connected")
    node.say(Stream.STATUS, status(0))
    node.wait_for((1, 0))
    for number in range(1, 300):
        node.say(Stream.FRAMES, frame(number))
    wait_until(lambda: len(node.acknowledged) > 10, "some are acknowledged")
    assert running.stop() == 0
    accepted = running.metrics.value("messages_accepted_total")
    wait_until(lambda: len(node.acknowledged) == accepted, "all that was accepted is acknowledged")
    assert len(cloud.stored) == accepted
