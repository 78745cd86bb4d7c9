"""Mosquitto as the demo's broker: several clients with one certificate, and revocations."""

from __future__ import annotations

import socket
from dataclasses import astuple
from datetime import timedelta
from typing import TYPE_CHECKING

import psutil
import pytest

from eskin.demo.identities import BROKER, CLIENT, GATEWAY, prepare_identities
from eskin.demo.layout import DemoFolder
from eskin.demo.mosquitto import Mosquitto
from eskin.demo.ports import free_ports
from eskin.demo.settings_files import Ports
from eskin.identity import (
    CertificateAuthority,
    Identity,
    IdentityKind,
    client_context,
    install,
    next_key,
)
from eskin.identity.identity import ROOT_FILE
from eskin.mosquitto import BrokerPorts
from tests.support.brokers import mosquitto
from tests.support.processes import accepts, wait_until
from tests.unit.services.party import Party

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

LIVE = "eskin/v1/live/fingertip/t01.area"
STATUS = "eskin/v1/live/fingertip/status"
FRAMES = "eskin/v1/nodes/fingertip/frames"
ACKS = "eskin/v1/nodes/fingertip/acks"


class Broker:
    """The demo's Mosquitto alone, with the demo's PKI."""

    def __init__(self, folder: Path) -> None:
        self.layout = DemoFolder(folder)
        prepare_identities(self.layout, ["fingertip", "palm"], lifetime=timedelta(days=1))
        self.authority = CertificateAuthority.open(self.layout.authority)
        self.ports = BrokerPorts(*free_ports(3))
        self.child = Mosquitto(mosquitto(), layout=self.layout, ports=Ports(0, 0, self.ports, 0))

    def start(self) -> None:
        self.child.start()
        wait_until(self._listens, "Mosquitto listens")

    def _listens(self) -> bool:
        """Asked of the system: Mosquitto 2.0.11 counts a connection that ended as two.

        Each connection that a test opens and closes would raise its limit of them by one.
        """
        self.child.require_alive()
        assert self.child.pid is not None
        sockets = psutil.Process(self.child.pid).net_connections("tcp")
        listening = {at.laddr.port for at in sockets if at.status == psutil.CONN_LISTEN}
        return listening == set(astuple(self.ports))

    def identity(self, name: str) -> Identity:
        return Identity.load(self.layout.identity(name))

    def party(self, name: str, *, client_id: str | None = None) -> Party:
        port = {GATEWAY: self.ports.gateways, CLIENT: self.ports.clients}.get(name)
        root = self.layout.authority / ROOT_FILE
        return Party(self.identity(name), port or self.ports.nodes, root=root, client_id=client_id)


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    # Mosquitto's configuration knows no quotes, and the path of a socket file may have 107 bytes.
    running = Broker(tmp_path / "some data" / ("long" * 30))
    try:
        running.start()
        yield running
    finally:
        running.child.stop()


def test_clients_with_one_certificate_read_together_and_write_nothing(broker: Broker) -> None:
    with (
        broker.party(GATEWAY) as gateway,
        broker.party(CLIENT, client_id="") as one,
        broker.party(CLIENT, client_id="other") as other,
    ):
        gateway.subscribe("#")
        for reader in (one, other):
            reader.subscribe("#")
        for topic in (LIVE, FRAMES, ACKS):
            one.publish(topic, b"forged")
        gateway.publish(ACKS, b"private")
        gateway.publish(LIVE, b"genuine")
        wait_until(lambda: bool(one.heard and other.heard), "what is public arrives")
        assert one.heard == other.heard == [(LIVE, b"genuine")]
        assert gateway.heard == []
        assert one.connected


def test_party_without_certificate_is_refused(broker: Broker) -> None:
    for port in astuple(broker.ports):
        with Party(None, port, root=broker.layout.authority / ROOT_FILE) as party:
            assert party.refused


def test_client_that_takes_a_node_s_client_id_reads_nothing_of_it(broker: Broker) -> None:
    with broker.party(GATEWAY) as gateway, broker.party("fingertip") as node:
        node.subscribe(ACKS)
        with broker.party(CLIENT, client_id="fingertip") as thief:
            thief.subscribe("#")
            gateway.publish(ACKS, b"for fingertip")
            gateway.publish(LIVE, b"last")
            wait_until(lambda: bool(thief.heard), "what is public arrives")
            assert thief.heard == [(LIVE, b"last")]
            with broker.party("fingertip") as again:
                again.subscribe(ACKS)
                gateway.publish(ACKS, b"for fingertip")
                wait_until(lambda: bool(again.heard), "the node is served again")


def test_connections_of_clients_are_limited_and_nodes_are_served(broker: Broker) -> None:
    held = [socket.create_connection(("127.0.0.1", broker.ports.clients)) for _ in range(64)]
    try:
        with socket.create_connection(("127.0.0.1", broker.ports.clients)) as one_more:
            one_more.settimeout(60)
            assert one_more.recv(1) == b""
        with broker.party("fingertip") as node:
            assert node.connected
    finally:
        for one in held:
            one.close()


def test_revoked_node_is_cut_off_and_kept_out_and_others_come_back(broker: Broker) -> None:
    with broker.party(GATEWAY) as gateway:
        gateway._client.publish(STATUS, b"kept", qos=1, retain=True)
        gateway.publish(LIVE, b"behind it")
    with broker.party(CLIENT) as client, broker.party("palm") as node:
        assert client.connected
        broker.authority.revoke("palm")

        def is_out() -> bool:
            broker.child.keep_alive()
            return node.refused

        wait_until(is_out, "its open connection is ended")
    wait_until(lambda: accepts(broker.ports.clients), "Mosquitto listens")
    wait_until(lambda: accepts(broker.ports.nodes), "Mosquitto listens")
    with broker.party("palm") as node, broker.party("fingertip") as other:
        assert node.refused
        assert other.connected
    with broker.party(CLIENT) as client:
        client.subscribe(STATUS)
        wait_until(lambda: client.heard == [(STATUS, b"kept")], "what is retained is kept")


def test_renewed_certificate_is_shown_and_connections_stay(broker: Broker) -> None:
    directory = broker.layout.identity(BROKER)
    key = next_key(directory)
    chain = broker.authority.issue(
        IdentityKind.SERVER, BROKER, key.public_key(), hosts=["127.0.0.1", "localhost"]
    )
    with broker.party("fingertip") as node:
        install(directory, chain)

        def is_shown() -> bool:
            broker.child.keep_alive()
            return shown(broker) == chain[0].serial_number

        wait_until(is_shown, "the new certificate is shown")
        assert node.connected


def shown(broker: Broker) -> int:
    """Serial number of the certificate that the broker shows to a node."""
    node = broker.identity("fingertip")
    context = client_context(broker.layout.authority / ROOT_FILE, node)
    address = ("127.0.0.1", broker.ports.nodes)
    with (
        socket.create_connection(address) as plain,
        context.wrap_socket(plain, server_hostname="127.0.0.1") as tls,
    ):
        certificate = tls.getpeercert()
    assert certificate is not None
    return int(str(certificate["serialNumber"]), 16)
