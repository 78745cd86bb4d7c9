"""Mosquitto's configuration: a listener for each kind of party, with an access list of its own.

`versions` and `revoked` look at the files that Mosquitto reads again on SIGHUP.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from eskin.identity import IdentityKind
from eskin.identity.crl import revoked_serials
from eskin.identity.identity import CHAIN_FILE
from eskin.runtime.files.stamp import version

if TYPE_CHECKING:
    from eskin.runtime.files.stamp import Version

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


def versions(*, identity: Path, anchors: Path) -> tuple[Version, ...]:
    """Their versions: others once one of the files was replaced.

    Args:
        identity: Folder of the broker's identity.
        anchors: Folder with ``KIND.anchor.pem`` and ``KIND.crl.pem``.

    Raises:
        OSError: One cannot be looked at.
    """
    ends = (".anchor.pem", ".crl.pem")
    files = [anchors / f"{kind}{end}" for kind in KINDS for end in ends]
    return tuple(version(file) for file in (identity / CHAIN_FILE, *files))


def revoked(anchors: Path) -> set[str]:
    """Serial numbers of the certificates that Mosquitto refuses by its revocation lists.

    Raises:
        OSError: A list cannot be read.
        ValueError: A list cannot be parsed.
    """
    lists = [anchors / f"{kind}.crl.pem" for kind in KINDS]
    return {serial for file in lists for serial in revoked_serials(file.read_bytes())}
