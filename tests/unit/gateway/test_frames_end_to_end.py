"""Frames from node over broker and spool to cloud, with the layouts by which they are read."""

from __future__ import annotations

from typing import TYPE_CHECKING

import orjson
import pytest
from eskin_gateway.service import Gateway

from eskin.identity import IdentityKind
from eskin.wire.frames import content_hash
from eskin.wire.topics import Stream, live_topic
from tests.support.processes import wait_until
from tests.unit.gateway.messages import frame, status
from tests.unit.gateway.skins import LARGE, SMALL, SkinNode
from tests.unit.gateway.wire_node import Listener, WireNode

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_gateway.settings import GatewaySettings

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities
    from tests.unit.gateway.stub_cloud import StubCloud


@pytest.fixture
def palm(identities: Identities, broker: Mosquitto) -> Iterator[WireNode]:
    own = identities.make(IdentityKind.NODE, "palm")
    with WireNode(own, identities.site, broker.node_port) as running:
        yield running


def test_layout_is_asked_for_sent_again_and_reaches_the_cloud(
    gateway: Gateway, cloud: StubCloud, node: WireNode
) -> None:
    skin = SkinNode(node, LARGE)
    node.say(Stream.STATUS, status(0))
    skin.send(1, 2, 3)
    assert set(node.wanted) == set(LARGE.hashes)
    node.say(Stream.EVENTS, LARGE.statements(4))
    node.wait_for((1, 4))
    frames = [("fingertip", LARGE.frame(number).encode()) for number in (1, 2, 3)]
    statements = ("fingertip", LARGE.statements(4).encode())
    wait_until(lambda: statements in cloud.stored, "the cloud stored all")
    assert [each for each in cloud.stored if each in frames] == frames
    posted = {("fingertip", name) for name in LARGE.hashes}
    assert set(cloud.descriptions) == posted
    assert all(content_hash(body) == name for (_, name), body in cloud.descriptions.items())
    wait_until(lambda: gateway.spool.statistics.messages == 0, "the spool is empty")
    assert gateway.spool.dead_letters() == []


def test_layout_that_never_comes_makes_dead_letters_and_delays_no_other_node(
    settings: GatewaySettings, cloud: StubCloud, node: WireNode, palm: WireNode
) -> None:
    nodes = settings.nodes.model_copy(update={"layout_wait_s": 3.0})
    running = Gateway(settings.model_copy(update={"nodes": nodes}))
    running.start()
    wait_until(lambda: running.broker.connected, "the gateway is connected")
    node.say(Stream.STATUS, status(0))
    palm.say(Stream.STATUS, status(0))
    other = SkinNode(palm, SMALL)
    other.describe()
    sequence, ended = 1, False
    while not ended:
        node.say(Stream.FRAMES, SMALL.frame(1))
        other.send(sequence)
        ended = (1, 1) in node.acknowledged
        if not ended:
            assert not running.spool.dead_letters()
        sequence += 1
    (letter,) = running.spool.dead_letters()
    assert (letter.node, letter.body) == ("fingertip", b"")
    other_skin = frame(2)
    node.say(Stream.FRAMES, other_skin)
    node.wait_for((1, 2))
    wait_until(lambda: len(cloud.stored) == 2 + sequence - 1 + 1, "the cloud stored all others")
    running.stop()


@pytest.mark.usefixtures("gateway")
def test_public_topics_carry_hulls_of_patches(
    node: WireNode, identities: Identities, broker: Mosquitto
) -> None:
    client = identities.make(IdentityKind.CLIENT, "client.demo")
    with Listener(client, broker.client_port) as listener:
        node.say(Stream.STATUS, status(0))
        skin = SkinNode(node, LARGE)
        skin.describe()
        skin.send(*range(1, 30))
        topic = live_topic("fingertip", "patches/pad000")

        def count() -> int:
            return sum(orjson.loads(body)["n"] for body in listener.on(topic))

        wait_until(lambda: count() == 29 * 5, "all samples are in a hull, also the last")
        assert len(listener.on(topic)) < 29
        channel = live_topic("fingertip", LARGE.patches[0].channels[0])
        assert listener.on(channel) == []
        online = [orjson.loads(s)["online"] for s in listener.on(live_topic("fingertip", "status"))]
        assert online[0] is True


@pytest.mark.usefixtures("gateway")
def test_node_that_sends_frames_alone_is_online(
    node: WireNode, identities: Identities, broker: Mosquitto
) -> None:
    client = identities.make(IdentityKind.CLIENT, "client.demo")
    with Listener(client, broker.client_port) as listener:
        node.say(Stream.STATUS, status(0))
        topic = live_topic("fingertip", "status")
        wait_until(lambda: len(listener.on(topic)) >= 2, "online, and offline after silence")
        skin = SkinNode(node, SMALL)
        skin.describe()
        skin.send(1)
        wait_until(lambda: len(listener.on(topic)) >= 3, "online again")
        online = [orjson.loads(body)["online"] for body in listener.on(topic)]
        assert online[:3] == [True, False, True]
