"""Real MQTT brokers in tests: Mosquitto on loopback, configured as in production."""

from __future__ import annotations

import json
import shutil
from dataclasses import astuple
from pathlib import Path
from typing import TYPE_CHECKING, Self

from eskin_ca.mosquitto_agent import DYNAMIC_SECURITY

from eskin.demo.ports import free_ports
from eskin.identity import IdentityKind
from eskin.mosquitto import BrokerPorts, configuration, find_mosquitto
from eskin.mosquitto.configuration import KINDS
from tests.support.processes import Running, accepts

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.identity import Identity
    from tests.support.identities import Identities

_GUARD = Path(__file__).parents[2] / "services" / "broker" / "guard.conf"
"""What containers add to the configuration."""


def mosquitto() -> Path:
    """Path of the broker's program."""
    found = find_mosquitto()
    assert found is not None, "mosquitto is missing; install it (apt-get install mosquitto)"
    return found


def write_configuration(
    folder: Path,
    identities: Identities,
    server: Identity,
    *,
    host: str,
    ports: BrokerPorts,
) -> Path:
    """Fill in production's configuration.

    Args:
        folder: Takes it, and the broker's data.
        identities: Whose CAs the listeners trust.
        server: The broker's identity.
        host: Address to listen on.
        ports: On which to listen.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for kind in KINDS:
        shutil.copy(identities.authority.anchor_file(kind), folder / f"{kind}.anchor.pem")
        shutil.copy(identities.authority.revocations_file(kind), folder / f"{kind}.crl.pem")
    (folder / "dynamic-security.json").write_text(json.dumps(DYNAMIC_SECURITY))
    (plugin,) = Path("/usr/lib").glob("*/mosquitto_dynamic_security.so")
    config = configuration(
        host=host, ports=ports, identity=server.directory, anchors=folder, data=folder
    )
    guard = _GUARD.read_text().replace("@ANCHORS@", str(folder)).replace("@PLUGIN@", str(plugin))
    file = folder / "mosquitto.conf"
    # Started as root, Mosquitto becomes another user, who must not need to read our keys.
    file.write_text(f"user root\n{config}{guard}")
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
        ports = BrokerPorts(*free_ports(3))
        self.node_port, self.gateway_port, self.client_port = astuple(ports)
        server = identities.make(IdentityKind.SERVER, "server.broker")
        file = write_configuration(folder, identities, server, host="127.0.0.1", ports=ports)
        super().__init__([*guard, str(mosquitto()), "-c", str(file)], log=folder / "mosquitto.log")

    def __enter__(self) -> Self:
        self.begin()
        return self

    def begin(self) -> None:
        """Start, and wait until it listens."""
        self.start()
        ports = self.node_port, self.gateway_port, self.client_port
        listens = "mosquitto listens"
        self.wait_for(lambda: all(accepts(port) for port in ports), listens)
