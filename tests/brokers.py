"""Real MQTT brokers in tests: Mosquitto on loopback, configured as in production."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Self

from authority.guard import DYNAMIC_SECURITY
from demo.ports import free_ports
from eskin.identity import IdentityKind
from tests.processes import Running, accepts

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.identity import Identity
    from tests.identities import Identities

PRODUCTION = Path(__file__).parents[1] / "services" / "broker"
"""Folder of the configuration that the broker's image takes."""


def mosquitto() -> str:
    """Path of the broker's program."""
    found = shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin:/usr/bin:/usr/local/bin")
    assert found is not None, "mosquitto is missing; install it (apt-get install mosquitto)"
    return found


def write_configuration(
    folder: Path,
    identities: Identities,
    server: Identity,
    *,
    host: str,
    ports: Sequence[int],
) -> Path:
    """Fill in production's configuration.

    Args:
        folder: Takes it, and the broker's data.
        identities: Whose CAs the listeners trust.
        server: The broker's identity.
        host: Address to listen on.
        ports: For nodes, gateways and clients.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for kind in (IdentityKind.NODE, IdentityKind.GATEWAY, IdentityKind.CLIENT):
        shutil.copy(identities.authority.anchor_file(kind), folder / f"{kind}.pem")
        shutil.copy(identities.authority.revocations_file(kind), folder / f"{kind}.crl.pem")
    (folder / "dynamic-security.json").write_text(json.dumps(DYNAMIC_SECURITY))
    (plugin,) = Path("/usr/lib").glob("*/mosquitto_dynamic_security.so")
    config = (PRODUCTION / "mosquitto.conf").read_text()
    for word, value in {
        "HOST": host,
        "NODES_PORT": ports[0],
        "GATEWAYS_PORT": ports[1],
        "CLIENTS_PORT": ports[2],
        "IDENTITY": server.directory,
        "ANCHORS": folder,
        "ACL": PRODUCTION / "acl",
        "DATA": folder,
        "PLUGIN": plugin,
    }.items():
        config = config.replace(f"@{word}@", str(value))
    file = folder / "mosquitto.conf"
    # Started as root, Mosquitto becomes another user, who must not need to read our keys.
    file.write_text(f"user root\n{config}")
    return file


class Mosquitto(Running):
    """A broker in a folder of its own; can be stopped and started again on the same ports.

    Attributes:
        node_port: Takes nodes alone.
        gateway_port: Takes gateways alone.
        client_port: Takes clients alone.

    Args:
        folder: Its own.
        identities: The CA.
        guard: What runs it; itself, where there is none.
    """

    def __init__(self, folder: Path, identities: Identities, *, guard: Sequence[str] = ()) -> None:
        # Held at once: asked for one by one, two of them may be the same.
        nodes, gateways, clients = ports = free_ports(3)
        self.node_port, self.gateway_port, self.client_port = nodes, gateways, clients
        server = identities.make(IdentityKind.SERVER, "server.broker")
        file = write_configuration(folder, identities, server, host="127.0.0.1", ports=ports)
        super().__init__([*guard, mosquitto(), "-c", str(file)], log=folder / "mosquitto.log")

    def __enter__(self) -> Self:
        self.begin()
        return self

    def begin(self) -> None:
        """Start, and wait until it listens."""
        self.start()
        ports = self.node_port, self.gateway_port, self.client_port
        listens = "mosquitto listens"
        self.wait_for(lambda: all(accepts(port) for port in ports), listens)
