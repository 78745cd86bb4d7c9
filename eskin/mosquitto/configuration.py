"""Mosquitto's configuration: a listener for each kind of party, with an access list of its own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from eskin.identity import IdentityKind

KINDS: Final = (IdentityKind.NODE, IdentityKind.GATEWAY, IdentityKind.CLIENT)
"""The kinds of parties that connect to the broker."""
_FOLDER: Final = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class BrokerPorts:
    """Ports of the broker.

    Attributes:
        nodes: Takes nodes.
        gateways: Takes gateways.
        clients: Takes other MQTT clients.
    """

    nodes: int
    gateways: int
    clients: int


def configuration(
    *, host: str, ports: BrokerPorts, identity: Path, anchors: Path, data: Path
) -> str:
    """``mosquitto.conf``, filled in; what is added to it configures the listener for clients.

    Args:
        host: Address to listen on.
        ports: On which to listen.
        identity: Folder of the broker's identity.
        anchors: Folder with ``KIND.anchor.pem`` and ``KIND.crl.pem``, as in a CA's folder.
        data: Folder of what Mosquitto keeps.
    """
    text = (_FOLDER / "mosquitto.conf").read_text()
    for word, value in {
        "HOST": host,
        "NODES_PORT": ports.nodes,
        "GATEWAYS_PORT": ports.gateways,
        "CLIENTS_PORT": ports.clients,
        "IDENTITY": identity,
        "ANCHORS": anchors,
        "ACL": _FOLDER / "acl",
        "DATA": data,
    }.items():
        text = text.replace(f"@{word}@", str(value))
    return text
