"""The configuration files that the demo writes for its processes.

They are ordinary files of the processes' own commands: a user can copy and change them.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from eskin_sensor_node.profile import Profile, profile_names

from eskin.demo.identities import BROKER, CLOUD, GATEWAY, SITE
from eskin.demo.ports import LOOPBACK
from eskin.errors import SettingsError
from eskin.identity import IdentityKind
from eskin.identity.identity import CHAIN_FILE
from eskin.mosquitto import BrokerPorts, configuration

if TYPE_CHECKING:
    from eskin.demo.layout import DemoFolder

PROFILES: Final = ("fingertip", "palm", "forearm", "hand")
"""The nodes that come with eskin; the demo takes them in turn."""
_CLIENTS: Final = """
# A client's certificate holds several connections, each with a client id of its own choice.
use_username_as_clientid false
max_connections 64
"""
TRUTH_BYTES: Final = 4_000_000_000
"""About a day of a node at 1 kHz and six channels. Of 8,400 taxels at 50 Hz it holds 14 hours at
rest, where the truth is deflated to 80 kB/s, and 20 minutes if nothing deflates it (3.4 MB/s)."""


@dataclass(frozen=True, slots=True)
class Ports:
    """Where the demo's processes listen, all on loopback.

    Attributes:
        people: Dashboard and REST API (HTTP).
        ingest: The cloud's listener for gateways (HTTPS).
        broker: MQTT (TLS); the embedded broker takes all parties on one port.
        gateway: The gateway's health and metrics (HTTP).
    """

    people: int
    ingest: int
    broker: BrokerPorts
    gateway: int


def node_profiles(count: int, skin: str | None = None) -> dict[str, str]:
    """Profiles of so many nodes by their names: fingertip, palm, forearm, hand, fingertip-2, ….

    Raises:
        SettingsError: There is no packaged skin of the name ``skin``.
    """
    if skin is not None and skin not in skin_names():
        raise SettingsError("--skin", f"{skin!r} is not allowed; use one of {skin_names()}")
    profiles = PROFILES if skin is None else (skin,)
    found = {}
    for i in range(count):
        turn, profile = divmod(i, len(profiles))
        found[profiles[profile] + (f"-{turn + 1}" if turn else "")] = profiles[profile]
    return found


def skin_names() -> list[str]:
    """Packaged profiles of large skins."""
    return [name for name in profile_names() if "skin" in Profile.read(name).sections]


def write_cloud(layout: DemoFolder, ports: Ports) -> Path:
    """Write the cloud's settings."""
    return _write(
        layout.settings("cloud"),
        {
            "store": {"path": layout.store},
            "keys": {"directory": layout.cloud_keys},
            "people": {"host": LOOPBACK, "port": ports.people},
            "gateways": {
                "host": LOOPBACK,
                "port": ports.ingest,
                "identity": layout.identity(CLOUD),
                "revocations": layout.revocations(IdentityKind.GATEWAY),
            },
            "nodes": {"revocations": layout.revocations(IdentityKind.NODE)},
        },
    )


def write_gateway(layout: DemoFolder, ports: Ports) -> Path:
    """Write the gateway's settings."""
    return _write(
        layout.settings("gateway"),
        {
            "broker": {"host": LOOPBACK, "port": ports.broker.gateways},
            "identity": {
                "directory": layout.identity(GATEWAY),
                "site": layout.identity(SITE),
                "revocations": layout.revocations(IdentityKind.NODE),
            },
            "cloud": {"url": f"https://{LOOPBACK}:{ports.ingest}/api/v1/ingest"},
            "spool": {"path": layout.spool},
            "keys": {"directory": layout.keys, "share": True},
            "http": {"host": LOOPBACK, "port": ports.gateway},
        },
    )


def write_node(layout: DemoFolder, name: str, profile_name: str) -> Path:
    """Write a node's settings from its profile, unless they are there: then they are the user's."""
    path = layout.node_settings(name)
    if path.exists():
        return path
    profile = Profile.read(profile_name)
    sections: dict[str, dict[str, object]] = {
        "node": {
            "name": name,
            "profile": profile.name,
            "description": profile.description,
        },
        "identity": {
            "directory": layout.identity(name),
            "site": layout.identity(SITE) / CHAIN_FILE,
        },
        "flash": {"path": layout.flash(name)},
        "truth": {"path": layout.truth(name), "limit_bytes": TRUTH_BYTES},
    }
    head = (
        "# Made by `eskin demo`, yours to change: it is read at each start and never overwritten.\n"
    )
    return _write(path, sections, head=head, tail="\n" + profile.text)


def node_environment(ports: Ports, speed: float | None) -> dict[str, str]:
    """What changes from start to start, so that a node's file stays the user's."""
    broker = {"ESKIN_BROKER_HOST": LOOPBACK, "ESKIN_BROKER_PORT": str(ports.broker.nodes)}
    return broker if speed is None else broker | {"ESKIN_NODE_SPEED": repr(speed)}


def write_mosquitto(layout: DemoFolder, ports: Ports) -> Path:
    """Write Mosquitto's configuration."""
    text = configuration(
        host=LOOPBACK,
        ports=ports.broker,
        identity=broker_identity(layout),
        anchors=layout.authority,
        data=layout.broker,
    )
    layout.broker.mkdir(mode=0o700, parents=True, exist_ok=True)
    path = layout.broker / "mosquitto.conf"
    # Started as root, Mosquitto becomes another user, who must not need to read our keys.
    path.write_text(f"user root\n{text}{_CLIENTS}")
    return path


def broker_identity(layout: DemoFolder) -> Path:
    """Folder of the broker's identity."""
    return layout.identity(BROKER)


def _write(
    path: Path,
    sections: dict[str, dict[str, object]],
    *,
    head: str = "# Written by `eskin demo` at each start.\n",
    tail: str = "",
) -> Path:
    lines = [head]
    for section, values in sections.items():
        lines.append(f"\n[{section}]\n")
        lines.extend(f"{name} = {_written(value, path.parent)}\n" for name, value in values.items())
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join([*lines, tail]))
    return path


def _written(value: object, folder: Path) -> str:
    """A value in TOML, whose integers, booleans and basic strings are JSON's.

    Paths are relative to the file's folder: the data folder can be moved.
    """
    if isinstance(value, Path):
        value = os.path.relpath(value, folder)
    return json.dumps(value if isinstance(value, int) else str(value))
