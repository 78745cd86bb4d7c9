"""The embedded broker closes amqtt's known holes."""

from __future__ import annotations

import socket
import sys
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import paho.mqtt.client as mqtt
import pytest
from paho.mqtt.enums import CallbackAPIVersion

from eskin.demo.broker import Party, may_publish, may_subscribe
from eskin.demo.broker.broker import MOST_CONNECTIONS
from eskin.identity import CertificateAuthority, Identity, IdentityKind, client_context, new_key
from eskin.wire.envelope import MOST_ENVELOPE
from tests.support.identities import SITE
from tests.support.processes import Running, accepts, free_port, wait_until

if TYPE_CHECKING:
    import ssl
    from collections.abc import Iterator

    from tests.support.identities import Identities

FRAMES = "eskin/v1/nodes/fingertip/frames"
ACKS = "eskin/v1/nodes/fingertip/acks"
PALM_FRAMES = "eskin/v1/nodes/palm/frames"
PALM_ACKS = "eskin/v1/nodes/palm/acks"
PATIENCE_S = 60.0


class Peer:
    """A paho client that keeps what it saw."""

    def __init__(
        self, port: int, identity: Identity | None, root: Path, *, client_id: str = "",
        will: str | None = None,
    ) -> None:  # fmt: skip
        self.messages: list[tuple[str, bytes]] = []
        self.granted: list[bool] = []
        self.connections = 0
        self.losses = 0
        self.client = mqtt.Client(CallbackAPIVersion.VERSION2, client_id=client_id)
        self.client.tls_set_context(client_context(root, identity))
        self.client.connect_timeout = PATIENCE_S
        if will:
            self.client.will_set(will, b"will", qos=1)
        self.client.on_connect = self._connected
        self.client.on_disconnect = self._lost
        self.client.on_message = lambda _c, _u, m: self.messages.append((m.topic, bytes(m.payload)))
        self.client.on_subscribe = lambda _c, _u, _m, codes, _p: self.granted.extend(
            not code.is_failure for code in codes
        )
        try:
            self.client.connect("127.0.0.1", port)
        except OSError:
            self.client._reset_sockets()
            raise
        self.client.loop_start()

    def _connected(self, *_: object) -> None:
        self.connections += 1

    def _lost(self, *_: object) -> None:
        self.losses += 1

    def subscribe(self, pattern: str) -> bool:
        before = len(self.granted)
        self.client.subscribe(pattern, qos=1)
        wait_until(lambda: len(self.granted) > before, f"answer to subscribing {pattern}")
        return self.granted[-1]

    def publish(
        self, topic: str, payload: bytes = b"x", *, qos: int = 1, retain: bool = False
    ) -> None:
        sent = self.client.publish(topic, payload, qos=qos, retain=retain)
        sent.wait_for_publish(PATIENCE_S)
        assert sent.is_published(), f"{topic} is not acknowledged"

    def said(self) -> set[bytes]:
        return {payload for _, payload in self.messages}

    def close(self) -> None:
        self.client.disconnect()
        self.client.loop_stop()
        self.client._reset_sockets()


def is_refused(
    port: int, identity: Identity | None, root: Path, *, will: str | None = None
) -> bool:
    try:
        peer = Peer(port, identity, root, will=will)
    except OSError:
        return True
    wait_until(lambda: peer.losses > 0 or peer.connections > 0, "the broker answers")
    peer.close()
    return peer.connections == 0


@pytest.fixture(scope="module")
def broker(
    identities: Identities, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Running, int]]:
    server = identities.make(IdentityKind.SERVER, "server.broker")
    number = free_port()
    argv = [
        sys.executable,
        "-m",
        "eskin.demo.broker",
        str(server.directory),
        str(identities.ca),
        str(number),
    ]
    with Running(argv, log=tmp_path_factory.mktemp("broker") / "log") as process:
        process.wait_for(lambda: accepts(number), "the broker listens")
        yield process, number


@pytest.fixture
def port(broker: tuple[Running, int]) -> int:
    return broker[1]


@pytest.fixture
def peers(identities: Identities, port: int) -> Iterator[dict[str, Peer]]:
    root = identities.node.directory / "root.pem"
    client = identities.make(IdentityKind.CLIENT, "client.demo")
    made = {
        "node": Peer(port, identities.node, root, client_id="fingertip"),
        "gateway": Peer(port, identities.gateway, root, client_id="gateway"),
        "client": Peer(port, client, root),
    }
    for name, peer in made.items():
        wait_until(lambda peer=peer: peer.connections == 1, f"{name} connects")  # type: ignore[misc]  # mypy infers no lambda defaults
    yield made
    for peer in made.values():
        peer.close()


def test_node_reaches_gateway_and_gateway_reaches_node(peers: dict[str, Peer]) -> None:
    assert peers["gateway"].subscribe("eskin/v1/nodes/+/frames")
    assert peers["node"].subscribe(ACKS)
    peers["node"].publish(FRAMES, b"frame")
    peers["gateway"].publish(ACKS, b"ack")
    wait_until(lambda: peers["gateway"].messages == [(FRAMES, b"frame")], "frame arrives")
    wait_until(lambda: peers["node"].messages == [(ACKS, b"ack")], "ack arrives")


def test_what_a_node_writes_elsewhere_reaches_no_client(peers: dict[str, Peer]) -> None:
    assert peers["gateway"].subscribe("eskin/v1/nodes/+/frames")
    assert peers["client"].subscribe("eskin/v1/live/#")
    for topic in (PALM_FRAMES, "eskin/v1/live/fingertip/t01.current"):
        peers["node"].publish(topic, b"forged")
    peers["node"].publish(FRAMES, b"genuine")
    wait_until(lambda: bool(peers["gateway"].messages), "genuine block arrives")
    assert peers["gateway"].messages == [(FRAMES, b"genuine")]
    live = "eskin/v1/live/fingertip/t01.area"
    peers["gateway"].publish(live, b"genuine")
    wait_until(lambda: bool(peers["client"].messages), "genuine value arrives")
    assert peers["client"].messages == [(live, b"genuine")]


def test_what_is_said_once_is_gone_without_subscribers_and_arrives_with_one(
    peers: dict[str, Peer],
) -> None:
    topic = "eskin/v1/live/fingertip/t01.area"
    peers["gateway"].publish(topic, b"early", qos=0)
    peers["gateway"].publish("eskin/v1/live/fingertip/status", b"kept", qos=0, retain=True)
    # Its answer comes when the broker has taken in what was said before.
    peers["gateway"].publish(ACKS)
    assert peers["client"].subscribe("eskin/v1/live/#")
    peers["gateway"].publish(topic, b"heard", qos=0)
    wait_until(lambda: {b"kept", b"heard"} <= peers["client"].said(), "both messages arrive")
    assert peers["client"].said() == {b"kept", b"heard"}
    peers["gateway"].publish("eskin/v1/live/fingertip/status", b"", retain=True)


def test_what_a_client_publishes_reaches_no_client(peers: dict[str, Peer]) -> None:
    live = "eskin/v1/live/fingertip/t01.current"
    assert peers["client"].subscribe("eskin/v1/live/#")
    assert peers["gateway"].subscribe("eskin/v1/nodes/+/frames")
    peers["client"].publish(live, b"forged")
    peers["client"].publish(FRAMES, b"forged")
    peers["gateway"].publish(live, b"genuine")
    peers["node"].publish(FRAMES, b"genuine")
    wait_until(lambda: bool(peers["client"].messages), "genuine value arrives")
    wait_until(lambda: bool(peers["gateway"].messages), "genuine block arrives")
    assert peers["client"].messages == [(live, b"genuine")]
    assert peers["gateway"].messages == [(FRAMES, b"genuine")]


def test_retained_message_goes_to_its_subscribers_only(
    identities: Identities, peers: dict[str, Peer], port: int
) -> None:
    status = "eskin/v1/nodes/fingertip/status"
    assert peers["gateway"].subscribe("eskin/v1/nodes/+/status")
    peers["node"].publish(status, b"chain", retain=True)
    wait_until(lambda: bool(peers["gateway"].messages), "status arrives")
    palm = identities.make(IdentityKind.NODE, "palm")
    outsider = Peer(port, palm, palm.directory / "root.pem")
    later = Peer(port, identities.gateway, palm.directory / "root.pem")
    wait_until(lambda: outsider.connections + later.connections == 2, "both connect")
    assert outsider.subscribe(PALM_ACKS)
    assert later.subscribe("eskin/v1/nodes/+/status")
    wait_until(lambda: later.messages == [(status, b"chain")], "retained status arrives")
    peers["gateway"].publish(PALM_ACKS, b"ack")
    wait_until(lambda: bool(outsider.messages), "ack arrives")
    outsider.close()
    later.close()
    assert outsider.messages == [(PALM_ACKS, b"ack")]


@pytest.mark.parametrize("pattern", ["#", "eskin/#", "eskin/v1/nodes/+/frames", ACKS, "+/+/+/+/+"])
def test_client_may_not_read_private_topics(peers: dict[str, Peer], pattern: str) -> None:
    assert not peers["client"].subscribe(pattern)


@pytest.mark.parametrize("pattern", ["#", FRAMES, PALM_ACKS, "eskin/v1/live/#"])
def test_node_may_read_its_own_answers_only(peers: dict[str, Peer], pattern: str) -> None:
    assert not peers["node"].subscribe(pattern)


def test_client_id_of_another_takes_no_session_over(
    identities: Identities, peers: dict[str, Peer], port: int
) -> None:
    palm = identities.make(IdentityKind.NODE, "palm")
    assert peers["node"].subscribe(ACKS)
    thief = Peer(port, palm, palm.directory / "root.pem", client_id="fingertip")
    wait_until(lambda: thief.connections == 1, "thief connects")
    assert not thief.subscribe(ACKS)
    assert thief.subscribe(PALM_ACKS)
    assert peers["gateway"].subscribe("eskin/v1/nodes/+/frames")
    thief.publish(FRAMES, b"forged")
    thief.publish(PALM_FRAMES, b"own")
    peers["gateway"].publish(ACKS, b"ack")
    wait_until(lambda: bool(peers["node"].messages), "ack arrives at its owner")
    peers["gateway"].publish(PALM_ACKS, b"own")
    wait_until(lambda: bool(thief.messages), "the thief's own ack arrives")
    wait_until(lambda: bool(peers["gateway"].messages), "the thief's own block arrives")
    thief.close()
    assert thief.messages == [(PALM_ACKS, b"own")]
    assert peers["gateway"].messages == [(PALM_FRAMES, b"own")]
    assert peers["node"].losses == 0


def test_will_on_a_foreign_topic_is_refused(
    identities: Identities, peers: dict[str, Peer], port: int
) -> None:
    palm = identities.make(IdentityKind.NODE, "palm")
    assert peers["gateway"].subscribe("eskin/v1/nodes/+/status")
    assert is_refused(port, palm, palm.directory / "root.pem", will="eskin/v1/nodes/x/status")
    peers["node"].publish("eskin/v1/nodes/fingertip/status", b"later")
    wait_until(lambda: b"later" in peers["gateway"].said(), "what is said later arrives")
    assert b"will" not in peers["gateway"].said()


def test_connection_without_certificate_is_refused(identities: Identities, port: int) -> None:
    assert is_refused(port, None, identities.node.directory / "root.pem")


def test_certificate_of_another_ca_is_refused(
    identities: Identities, port: int, tmp_path: Path
) -> None:
    outsider, key = CertificateAuthority.open(tmp_path / "ca"), new_key()
    chain = outsider.issue(IdentityKind.NODE, "fingertip", key.public_key(), site=SITE)
    forged = Identity.save(tmp_path / "id", key=key, chain=chain, roots=outsider.roots)
    assert is_refused(port, forged, identities.node.directory / "root.pem")


@pytest.mark.parametrize(
    ("kind", "name", "topic", "publishes", "reads"),
    [
        (IdentityKind.NODE, "n", "eskin/v1/nodes/n/frames", True, False),
        (IdentityKind.NODE, "n", "eskin/v1/nodes/n/acks", False, True),
        (IdentityKind.NODE, "n", "eskin/v1/nodes/m/acks", False, False),
        (IdentityKind.GATEWAY, "gateway.n", "eskin/v1/nodes/n/acks", True, False),
        (IdentityKind.GATEWAY, "gateway.n", "eskin/v1/nodes/n/frames", False, True),
        (IdentityKind.GATEWAY, "gateway.n", "eskin/v1/nodes/+/+", False, False),
        (IdentityKind.CLIENT, "client.n", "eskin/v1/nodes/client.n/acks", False, False),
        (IdentityKind.CLIENT, "client.n", "eskin/v1/live/n/status", False, True),
        (IdentityKind.GATEWAY, "gateway.n", "eskin/v1/senml/n/t01.current", True, True),
        (IdentityKind.GATEWAY, "gateway.n", "eskin/v1/alarms/squeeze", True, True),
        (IdentityKind.CLIENT, "client.n", "eskin/v1/alarms/squeeze", False, True),
        (IdentityKind.NODE, "n", "eskin/v1/alarms/squeeze", False, False),
        (IdentityKind.CLIENT, "client.n", "homeassistant/sensor/n/t01-current/config", False, True),
        (IdentityKind.NODE, "n", "homeassistant/sensor/n/t01-current/config", False, False),
        (IdentityKind.CLIENT, "client.n", "homeassistant", False, False),
        (IdentityKind.SERVER, "server.n", "eskin/v1/live/n/status", False, False),
        (IdentityKind.SITE, "site.n", "eskin/v1/nodes/n/frames", False, False),
    ],
)
def test_access_follows_kind_and_name(
    kind: IdentityKind, name: str, topic: str, *, publishes: bool, reads: bool
) -> None:
    party = Party(kind, name)
    assert may_publish(party, topic) is publishes
    assert may_subscribe(party, topic) is reads


def test_revoked_node_is_cut_off_and_kept_out_while_others_stay(
    identities: Identities, port: int, peers: dict[str, Peer]
) -> None:
    root = identities.node.directory / "root.pem"
    lost = identities.make(IdentityKind.NODE, "lost")
    peer = Peer(port, lost, root)
    wait_until(lambda: peer.connections == 1, "it connects")
    identities.authority.revoke("lost")
    wait_until(lambda: peer.losses > 0, "it is cut off")
    peer.close()
    assert is_refused(port, lost, root)
    assert all(other.losses == 0 for other in peers.values())
    assert not is_refused(port, identities.make(IdentityKind.NODE, "lost"), root)


def connected(port: int, identity: Identity, client_id: str) -> ssl.SSLSocket:
    """A socket on which the broker has accepted a CONNECT, or has closed the connection."""
    context = client_context(identity.directory / "root.pem", identity)
    plain = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    peer = context.wrap_socket(plain, server_hostname="127.0.0.1")
    body = b"\x00\x04MQTT\x04\x02\x00\x00" + len(client_id).to_bytes(2, "big") + client_id.encode()
    peer.sendall(bytes([0x10, len(body)]) + body)
    return peer


def resident_bytes(process: Running) -> int:
    assert process.process is not None
    status = Path(f"/proc/{process.process.pid}/status").read_text()
    (line,) = (line for line in status.splitlines() if line.startswith("VmRSS:"))
    return 1024 * int(line.split()[1])


def is_closed(peer: ssl.SSLSocket) -> bool:
    peer.settimeout(PATIENCE_S / 4)
    try:
        return not peer.recv(1)
    except TimeoutError:
        return False
    except OSError:
        return True


TOPIC = b"\xff\xff" + b"a" * 65_535
"""A topic, with its length."""


@pytest.mark.parametrize(
    ("first_byte", "part"),
    [(0x32, PALM_FRAMES.encode() * 2_500), (0x82, TOPIC + b"\x00"), (0xA2, TOPIC)],
    ids=["PUBLISH", "SUBSCRIBE", "UNSUBSCRIBE"],
)
def test_packet_that_announces_too_much_ends_its_connection(
    identities: Identities,
    broker: tuple[Running, int],
    peers: dict[str, Peer],
    first_byte: int,
    part: bytes,
) -> None:
    process, port = broker
    palm = identities.make(IdentityKind.NODE, "palm")
    topic = len(PALM_FRAMES).to_bytes(2, "big") + PALM_FRAMES.encode()
    beginning = (topic if first_byte == 0x32 else b"") + b"\x00\x01"
    before = resident_bytes(process)
    with connected(port, palm, "palm") as peer:
        assert peer.recv(4) == b"\x20\x02\x00\x00"
        with suppress(OSError):
            # 150 MB as a remaining length (MQTT 3.1.1, section 2.2.3), of which 64 MB are sent.
            peer.sendall(bytes([first_byte, 0x80, 0xA3, 0xC3, 0x47]) + beginning)
            for _ in range(1_000):
                peer.sendall(part)
        closed = is_closed(peer)
        grown = resident_bytes(process) - before
    assert closed
    assert grown < 16_000_000
    assert peers["gateway"].subscribe("eskin/v1/nodes/+/frames")
    peers["node"].publish(FRAMES, b"frame")
    wait_until(lambda: peers["gateway"].messages == [(FRAMES, b"frame")], "others are served")


def test_largest_message_passes(peers: dict[str, Peer]) -> None:
    assert peers["gateway"].subscribe("eskin/v1/nodes/+/frames")
    peers["node"].publish(FRAMES, bytes(MOST_ENVELOPE))
    wait_until(lambda: bool(peers["gateway"].messages), "the largest message arrives")
    assert peers["gateway"].messages == [(FRAMES, bytes(MOST_ENVELOPE))]


def test_certificate_has_a_bounded_number_of_connections(
    identities: Identities, peers: dict[str, Peer], port: int
) -> None:
    palm = identities.make(IdentityKind.NODE, "palm")
    with ExitStack() as stack:
        held = [
            stack.enter_context(connected(port, palm, f"palm-{i}")) for i in range(MOST_CONNECTIONS)
        ]
        assert all(peer.recv(4) == b"\x20\x02\x00\x00" for peer in held)
        assert is_refused(port, palm, palm.directory / "root.pem")
        assert not is_refused(port, identities.node, palm.directory / "root.pem")
        assert all(peer.losses == 0 for peer in peers.values())
    wait_until(lambda: not is_refused(port, palm, palm.directory / "root.pem"), "one is free again")
