"""Commands: fetched from the cloud, sealed for their node, retained until answered."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cbor2
import pytest
from eskin_gateway.commands.poller import CommandChanges
from eskin_gateway.commands.publisher import PendingCommands

from eskin.errors import CloudError, ForgedEnvelopeError, UnknownRecipientError
from eskin.identity import IdentityKind
from eskin.wire.envelope import Opener
from eskin.wire.topics import Stream, node_topic
from tests.support.processes import wait_until
from tests.unit.gateway.messages import frame, result, status
from tests.unit.gateway.wire_node import WireNode

if TYPE_CHECKING:
    from eskin_gateway.service import Gateway

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities
    from tests.unit.gateway.in_memory import Inside
    from tests.unit.gateway.stub_cloud import StubCloud
    from tests.unit.gateway.wire_node import Seal

TOPIC = node_topic("fingertip", Stream.COMMANDS)


@pytest.fixture
def known(inside: Inside, seal: Seal) -> Inside:
    """A gateway that knows the node."""
    introduced = seal("fingertip", Stream.STATUS, status(0).encode(), introduce=True)
    inside.arrive(Stream.STATUS, introduced)
    return inside


def opener(identities: Identities) -> Opener:
    site = identities.site
    return Opener(
        [identities.node], sender=lambda p: site.certificate if p == site.thumbprint else None
    )


def published(inside: Inside) -> list[tuple[bytes, bool]]:
    return [(data, keep) for topic, data, keep in inside.broker.published if topic == TOPIC]


def test_command_is_sealed_for_its_node_and_retained(known: Inside, identities: Identities) -> None:
    known.commands.change([("fingertip", 7, b"signed")], [])
    known.command_publisher.publish_due()
    ((sealed, kept),) = published(known)
    assert kept
    assert opener(identities).open(sealed, topic=TOPIC).plaintext == b"signed"
    assert b"signed" not in sealed
    with pytest.raises(ForgedEnvelopeError):
        opener(identities).open(sealed, topic=node_topic("palm", Stream.COMMANDS))
    palm = identities.make(IdentityKind.NODE, "palm")
    with pytest.raises(UnknownRecipientError):
        Opener([palm], sender=lambda _: identities.site.certificate).open(sealed, topic=TOPIC)


def test_command_is_republished_until_it_is_answered(known: Inside, seal: Seal) -> None:
    known.commands.change([("fingertip", 7, b"signed")], [])
    for seconds, count in ((0.0, 1), (4.9, 1), (0.2, 2), (5.1, 3)):
        known.clock.seconds += seconds
        known.command_publisher.publish_due()
        assert len(published(known)) == count
    known.arrive(Stream.EVENTS, seal("fingertip", Stream.EVENTS, result(1, 6).encode()))
    known.clock.seconds += 5.1
    known.command_publisher.publish_due()
    assert len(published(known)) == 4, "an answer to an earlier command ends nothing"
    known.arrive(Stream.EVENTS, seal("fingertip", Stream.EVENTS, result(2, 7).encode()))
    for _ in range(3):
        known.clock.seconds += 5.1
        known.command_publisher.publish_due()
    assert published(known)[4:] == [(b"", True)], "the broker forgets it, once"
    assert known.commands.pending() == [("fingertip", 7, True)], "until the cloud knows"
    known.commands.change([], [("fingertip", 7)])
    assert known.commands.pending() == []


def test_next_command_is_published_after_the_last_was_withdrawn(known: Inside) -> None:
    known.commands.change([("fingertip", 7, b"first")], [])
    known.command_publisher.publish_due()
    known.commands.change([("fingertip", 8, b"second")], [("fingertip", 7)])
    known.command_publisher.publish_due()
    assert [data == b"" for data, _ in published(known)] == [False, True, False]
    assert known.commands.pending() == [("fingertip", 8, True)]


def test_command_waits_for_certificate_and_broker(inside: Inside, seal: Seal) -> None:
    inside.commands.change([("fingertip", 7, b"signed")], [])
    inside.command_publisher.publish_due()
    assert published(inside) == []
    introduced = seal("fingertip", Stream.STATUS, status(0).encode(), introduce=True)
    inside.arrive(Stream.STATUS, introduced)
    inside.broker.connected = False
    inside.command_publisher.publish_due()
    assert published(inside) == []
    assert inside.commands.pending() == [("fingertip", 7, False)]
    inside.broker.connected = True
    inside.command_publisher.publish_due()
    assert len(published(inside)) == 1


def test_late_change_of_an_earlier_command_is_ignored() -> None:
    commands = PendingCommands(5.0)
    commands.change([("n", 2, b"x")], [])
    commands.change([], [("n", 1)])
    commands.published("n", 1, 0.0)
    assert commands.pending() == [("n", 2, False)]
    assert commands.take_withdrawn() == []


def test_results_are_no_public_events(known: Inside, seal: Seal) -> None:
    known.arrive(Stream.EVENTS, seal("fingertip", Stream.EVENTS, result(1, 7).encode()))
    assert known.stored()[-1] == result(1, 7).encode()
    assert not [topic for topic, _, _ in known.broker.published if topic.endswith("/events")]


def test_command_reaches_the_node_and_the_cloud_learns_of_it(
    gateway: Gateway, cloud: StubCloud, node: WireNode
) -> None:
    node.say(Stream.STATUS, status(0))
    node.wait_for((1, 0))
    cloud.commands["fingertip"] = (7, b"signed")
    wait_until(lambda: bool(node.commands), "the command arrives")
    assert node.commands[0] == (b"signed", False)
    wait_until(lambda: cloud.held == {("fingertip", 7): True}, "the cloud knows it is delivered")
    node.say(Stream.EVENTS, result(1, 7))
    node.wait_for((1, 1))
    wait_until(lambda: ("fingertip", result(1, 7).encode()) in cloud.stored, "the cloud has it")
    del cloud.commands["fingertip"]
    wait_until(lambda: cloud.held == {}, "the gateway has dropped it")
    assert gateway.metrics.value("commands_answered_total") == 1


@pytest.mark.usefixtures("gateway")
def test_node_that_was_away_finds_its_command(
    cloud: StubCloud, broker: Mosquitto, identities: Identities
) -> None:
    with WireNode(identities.node, identities.site, broker.node_port) as node:
        node.say(Stream.STATUS, status(0))
        node.wait_for((1, 0))
    cloud.commands["fingertip"] = (7, b"signed")
    wait_until(lambda: cloud.held == {("fingertip", 7): True}, "it is delivered")
    with WireNode(identities.node, identities.site, broker.node_port) as node:
        wait_until(lambda: bool(node.commands), "the command waits")
        assert node.commands[0] == (b"signed", True)
        node.say(Stream.EVENTS, result(1, 7))
        node.wait_for((1, 1))
        node.say(Stream.FRAMES, frame(2))
        node.wait_for((1, 2))
    with WireNode(identities.node, identities.site, broker.node_port) as node:
        node.say(Stream.FRAMES, frame(3))
        node.wait_for((1, 3))
        assert node.commands == []


def test_commands_arrive_after_an_outage_of_the_cloud(
    gateway: Gateway, cloud: StubCloud, node: WireNode
) -> None:
    cloud.end()
    wait_until(lambda: gateway.command_poller.fault is not None, "it is noticed")
    node.say(Stream.STATUS, status(0))
    node.wait_for((1, 0))
    cloud.begin()
    # Sooner than by an answer for which it would have to wait 60 s.
    wait_until(lambda: gateway.command_poller.fault is None, "all is well again", seconds=45)
    cloud.commands["fingertip"] = (7, b"signed")
    wait_until(lambda: bool(node.commands), "the command arrives")


@pytest.mark.parametrize(
    "said",
    [
        b"<html>",
        cbor2.dumps([]),
        cbor2.dumps({"give": []}),
        cbor2.dumps({"give": {}, "drop": []}),
        cbor2.dumps({"give": [["fingertip", 1]], "drop": []}),
        cbor2.dumps({"give": [["fingertip", 1, "text"]], "drop": []}),
        cbor2.dumps({"give": [["fingertip", 1, bytes(65_537)]], "drop": []}),
        cbor2.dumps({"give": [["../acks", 1, b""]], "drop": []}),
        cbor2.dumps({"give": [], "drop": [["fingertip", 0]]}),
        cbor2.dumps({"give": [], "drop": [["fingertip"]]}),
    ],
)
def test_invalid_changes_are_rejected(said: bytes) -> None:
    with pytest.raises(CloudError):
        CommandChanges.decode(said)
