"""The broker's configuration keeps parties apart: Mosquitto itself runs it, with real keys."""

from __future__ import annotations

import socket
import ssl
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import pytest

from eskin.identity import CertificateAuthority, IdentityKind, new_key
from eskin.identity.identity import CHAIN_FILE, KEY_FILE, ROOT_FILE, Identity
from eskin.wire.envelope import MOST_ENVELOPE
from eskin.wire.topics import FROM_NODE
from tests.support.brokers import Mosquitto
from tests.support.identities import SITE
from tests.support.processes import wait_until
from tests.unit.services.party import Party

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.support.identities import Identities

MARK = "eskin/v1/live/mark"
"""What a gateway publishes last: when it has come, all that was allowed before it has come too."""


@pytest.fixture(scope="module")
def broker(tmp_path_factory: pytest.TempPathFactory, identities: Identities) -> Iterator[Mosquitto]:
    with Mosquitto(tmp_path_factory.mktemp("broker"), identities) as running:
        yield running


@pytest.fixture(scope="module")
def root(identities: Identities) -> Path:
    return identities.node.directory / ROOT_FILE


@pytest.fixture
def gateway(broker: Mosquitto, identities: Identities, root: Path) -> Iterator[Party]:
    with Party(identities.gateway, broker.gateway_port, root=root) as party:
        yield party.subscribe("#")


@pytest.fixture
def node(broker: Mosquitto, identities: Identities, root: Path) -> Iterator[Party]:
    with Party(identities.node, broker.node_port, root=root) as party:
        yield party.subscribe("#")


@pytest.fixture
def other_node(broker: Mosquitto, identities: Identities, root: Path) -> Iterator[Party]:
    palm = identities.make(IdentityKind.NODE, "palm")
    with Party(palm, broker.node_port, root=root) as party:
        yield party.subscribe("#")


@pytest.fixture
def client(broker: Mosquitto, identities: Identities, root: Path) -> Iterator[Party]:
    demo = identities.make(IdentityKind.CLIENT, "client.demo")
    with Party(demo, broker.client_port, root=root) as party:
        yield party.subscribe("#")


@pytest.mark.parametrize("kind", list(IdentityKind))
def test_listener_takes_its_own_kind_alone(
    broker: Mosquitto, identities: Identities, root: Path, kind: IdentityKind
) -> None:
    name = "visitor" if kind is IdentityKind.NODE else f"{kind}.visitor"
    visitor = identities.make(kind, name)
    ports = {
        IdentityKind.NODE: broker.node_port,
        IdentityKind.GATEWAY: broker.gateway_port,
        IdentityKind.CLIENT: broker.client_port,
    }
    for owner, port in ports.items():
        with Party(visitor, port, root=root) as party:
            assert party.connected == (owner is kind), f"{kind} at the listener of {owner}"


def test_party_without_certificate_is_refused(broker: Mosquitto, root: Path) -> None:
    for port in (broker.node_port, broker.gateway_port, broker.client_port):
        with Party(None, port, root=root) as party:
            assert party.refused


def test_expired_certificate_is_refused(
    broker: Mosquitto, identities: Identities, root: Path
) -> None:
    issued = datetime.now(UTC) - timedelta(days=2)
    old = identities.make(IdentityKind.NODE, "old", now=issued, lifetime=timedelta(days=1))
    with Party(old, broker.node_port, root=root) as party:
        assert party.refused


def test_certificate_of_another_ca_is_refused(
    broker: Mosquitto, root: Path, tmp_path: Path
) -> None:
    other = CertificateAuthority.open(tmp_path / "ca")
    key = new_key()
    chain = other.issue(IdentityKind.NODE, "fingertip", key.public_key(), site=SITE)
    outsider = Identity.save(tmp_path / "fingertip", key=key, chain=chain, roots=other.roots)
    with Party(outsider, broker.node_port, root=root) as party:
        assert party.refused


def test_tls_older_than_1_2_is_refused(
    broker: Mosquitto, identities: Identities, root: Path
) -> None:
    context = ssl.create_default_context(cafile=root)
    own = identities.node.directory
    context.load_cert_chain(own / CHAIN_FILE, own / KEY_FILE)
    context.minimum_version = ssl.TLSVersion.MINIMUM_SUPPORTED
    with pytest.warns(DeprecationWarning, match="TLSv1_1"):
        context.maximum_version = ssl.TLSVersion.TLSv1_1
    context.set_ciphers("ALL:@SECLEVEL=0")
    with (
        socket.create_connection(("127.0.0.1", broker.node_port)) as plain,
        pytest.raises((ssl.SSLError, ConnectionError)),
    ):
        context.wrap_socket(plain, server_hostname="localhost")


def test_node_writes_and_reads_under_its_own_name_alone(
    gateway: Party, node: Party, other_node: Party, client: Party
) -> None:
    own = [f"eskin/v1/nodes/fingertip/{leaf}" for leaf in FROM_NODE]
    for topic in (
        *own,
        "eskin/v1/nodes/fingertip/acks",
        "eskin/v1/nodes/fingertip/commands",
        "eskin/v1/nodes/palm/frames",
        "eskin/v1/nodes/palm/acks",
        "eskin/v1/live/fingertip/status",
        "$SYS/broker/uptime",
    ):
        node.publish(topic, b"from fingertip")
    gateway.publish("eskin/v1/nodes/fingertip/acks", b"for fingertip")
    gateway.publish("eskin/v1/nodes/palm/commands", b"for palm")
    gateway.publish(MARK, b"")
    wait_until(lambda: (MARK, b"") in client.heard, "the mark arrives")
    wait_until(
        lambda: len(gateway.heard) == len(own) and bool(node.heard and other_node.heard),
        "all arrive",
    )
    assert gateway.heard == [(topic, b"from fingertip") for topic in own]
    assert node.heard == [("eskin/v1/nodes/fingertip/acks", b"for fingertip")]
    assert other_node.heard == [("eskin/v1/nodes/palm/commands", b"for palm")]
    assert client.heard == [(MARK, b"")]


def test_greatest_sealed_message_passes_on_each_stream(gateway: Party, node: Party) -> None:
    topics = [f"eskin/v1/nodes/fingertip/{leaf}" for leaf in FROM_NODE]
    for topic in topics:
        node.publish(topic, bytes(MOST_ENVELOPE))
    node.publish(topics[-1], b"last")
    wait_until(lambda: (topics[-1], b"last") in gateway.heard, "the last arrives")
    assert [(topic, len(body)) for topic, body in gateway.heard[:-1]] == [
        (topic, MOST_ENVELOPE) for topic in topics
    ]


def test_client_writes_nothing(gateway: Party, node: Party, client: Party) -> None:
    for topic in (
        "eskin/v1/live/fingertip/status",
        "eskin/v1/nodes/fingertip/acks",
        "eskin/v1/nodes/fingertip/frames",
        "elsewhere",
    ):
        client.publish(topic, b"from client")
    gateway.publish("eskin/v1/nodes/fingertip/acks", b"last")
    gateway.publish(MARK, b"")
    node.publish("eskin/v1/nodes/fingertip/frames", b"last")
    wait_until(lambda: bool(gateway.heard and node.heard and client.heard), "the last arrive")
    assert gateway.heard == [("eskin/v1/nodes/fingertip/frames", b"last")]
    assert node.heard == [("eskin/v1/nodes/fingertip/acks", b"last")]
    assert client.heard == [(MARK, b"")]


def test_what_is_for_other_clients_comes_from_gateways_alone(
    gateway: Party, node: Party, client: Party
) -> None:
    topics = [
        "homeassistant/sensor/fingertip/t01-current/config",
        "eskin/v1/senml/fingertip/x",
        "eskin/v1/alarms/squeeze",
    ]
    for topic in topics:
        node.publish(topic, b"from node")
        client.publish(topic, b"from client")
        gateway.publish(topic, b"from gateway")
    gateway.publish(MARK, b"")
    wait_until(lambda: (MARK, b"") in client.heard, "the mark arrives")
    assert client.heard == [*((topic, b"from gateway") for topic in topics), (MARK, b"")]
    assert node.heard == []


def test_gateway_cannot_pass_for_a_node(gateway: Party, node: Party) -> None:
    gateway.publish("eskin/v1/nodes/fingertip/frames", b"forged")
    node.publish("eskin/v1/nodes/fingertip/frames", b"genuine")
    wait_until(lambda: bool(gateway.heard), "the genuine one arrives")
    assert gateway.heard == [("eskin/v1/nodes/fingertip/frames", b"genuine")]


def test_gateways_share_a_subscription(
    broker: Mosquitto, identities: Identities, root: Path, node: Party
) -> None:
    shared = "$share/site/eskin/v1/nodes/+/frames"
    second = identities.make(IdentityKind.GATEWAY, "gateway.g2")
    with (
        Party(identities.gateway, broker.gateway_port, root=root) as one,
        Party(second, broker.gateway_port, root=root) as two,
    ):
        one.subscribe(shared)
        two.subscribe(shared)
        for number in range(10):
            node.publish("eskin/v1/nodes/fingertip/frames", bytes([number]))
        wait_until(lambda: len(one.heard) + len(two.heard) == 10, "each block arrives once")
        assert one.heard
        assert two.heard


@pytest.mark.parametrize("kind", [IdentityKind.NODE, IdentityKind.CLIENT])
def test_client_id_of_another_takes_no_session_over(
    broker: Mosquitto,
    identities: Identities,
    root: Path,
    gateway: Party,
    node: Party,
    kind: IdentityKind,
) -> None:
    name, port = {
        IdentityKind.NODE: ("thief", broker.node_port),
        IdentityKind.CLIENT: ("client.thief", broker.client_port),
    }[kind]
    thief = identities.make(kind, name)
    with Party(thief, port, root=root, client_id="fingertip") as party:
        gateway.publish("eskin/v1/nodes/fingertip/acks", b"for fingertip")
        wait_until(lambda: bool(node.heard), "the node still receives")
        assert node.connected
        assert party.connected
        assert party.heard == []


def test_will_obeys_the_access_list(
    broker: Mosquitto, identities: Identities, root: Path, gateway: Party, client: Party
) -> None:
    ghosts = {
        "ghost": "eskin/v1/nodes/fingertip/frames",
        "spirit": "eskin/v1/nodes/spirit/status",
    }
    for name, topic in ghosts.items():
        identity = identities.make(IdentityKind.NODE, name)
        with Party(identity, broker.node_port, root=root, will=topic) as party:
            party.break_off()
            wait_until(lambda: f"{name} closed" in broker.output(), "the broker noticed")  # noqa: B023
    gateway.publish(MARK, b"")
    wait_until(lambda: bool(client.heard and gateway.heard), "the allowed will arrives")
    assert gateway.heard == [("eskin/v1/nodes/spirit/status", b"will")]


def test_retained_status_outlives_the_broker(
    tmp_path: Path, identities: Identities, root: Path
) -> None:
    with Mosquitto(tmp_path, identities) as broker:
        with Party(identities.node, broker.node_port, root=root) as node:
            node._client.publish("eskin/v1/nodes/fingertip/status", b"s", qos=1, retain=True)
            node.publish("eskin/v1/nodes/fingertip/events", b"e")
        broker.stop()
        broker.begin()
        with Party(identities.gateway, broker.gateway_port, root=root) as gateway:
            gateway.subscribe("eskin/v1/nodes/+/status")
            wait_until(lambda: bool(gateway.heard), "the status arrives")
            assert gateway.heard == [("eskin/v1/nodes/fingertip/status", b"s")]
