"""The configuration files that the demo writes for its processes.

They are ordinary files of the processes' own commands: a user can copy and change them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING, Final

from demo.identities import BROKER, CLOUD, GATEWAY, SITE
from demo.ports import LOOPBACK
from eskin.identity.identity import CHAIN_FILE

if TYPE_CHECKING:
    from pathlib import Path

    from demo.layout import Layout

PROFILES: Final = ("fingertip", "palm", "forearm")
"""The nodes that come with eskin; the demo takes them in turn."""


@dataclass(frozen=True, slots=True)
class Ports:
    """Where the demo's processes listen, all on loopback.

    Attributes:
        people: Dashboard and REST API (HTTP).
        ingest: The cloud's listener for gateways (HTTPS).
        broker: MQTT (TLS).
        gateway: The gateway's health and metrics (HTTP).
    """

    people: int
    ingest: int
    broker: int
    gateway: int


def node_names(count: int) -> list[str]:
    """Names of so many nodes: fingertip, palm, forearm, fingertip-2, …."""
    return [
        PROFILES[i % len(PROFILES)] + (f"-{i // len(PROFILES) + 1}" if i >= len(PROFILES) else "")
        for i in range(count)
    ]


def write_cloud(layout: Layout, ports: Ports) -> Path:
    """Write the cloud's settings."""
    return _write(
        layout.settings("cloud"),
        {
            "store": {"path": layout.store},
            "people": {"host": LOOPBACK, "port": ports.people},
            "gateways": {
                "host": LOOPBACK,
                "port": ports.ingest,
                "identity": layout.identity(CLOUD),
            },
        },
    )


def write_gateway(layout: Layout, ports: Ports) -> Path:
    """Write the gateway's settings."""
    return _write(
        layout.settings("gateway"),
        {
            "broker": {"host": LOOPBACK, "port": ports.broker},
            "identity": {"directory": layout.identity(GATEWAY), "site": layout.identity(SITE)},
            "cloud": {"url": f"https://{LOOPBACK}:{ports.ingest}/api/v1/ingest"},
            "spool": {"path": layout.spool},
            "http": {"host": LOOPBACK, "port": ports.gateway},
        },
    )


def write_node(layout: Layout, name: str) -> Path:
    """Write a node's settings from its profile, unless they are there: then they are the user's."""
    path = layout.node_settings(name)
    if path.exists():
        return path
    profile = name.split("-", maxsplit=1)[0]
    template = resources.files("sensor_node") / "profiles" / f"{profile}.toml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(template.read_text())
    return path


def node_environment(layout: Layout, ports: Ports, name: str, speed: float) -> dict[str, str]:
    """What a node must know of this demo, so that its file stays the user's."""
    return {
        "ESKIN_NODE_NAME": name,
        "ESKIN_NODE_SPEED": repr(speed),
        "ESKIN_BROKER_HOST": LOOPBACK,
        "ESKIN_BROKER_PORT": str(ports.broker),
        "ESKIN_IDENTITY_DIRECTORY": str(layout.identity(name)),
        "ESKIN_IDENTITY_SITE": str(layout.identity(SITE) / CHAIN_FILE),
        "ESKIN_FLASH_PATH": str(layout.node(name) / "flash.sqlite"),
        "ESKIN_TRUTH_PATH": str(layout.truth(name)),
    }


def broker_identity(layout: Layout) -> Path:
    """Folder of the broker's identity."""
    return layout.identity(BROKER)


def _write(path: Path, sections: dict[str, dict[str, object]]) -> Path:
    lines = ["# Written by `eskin demo` at each start.\n"]
    for section, values in sections.items():
        lines.append(f"\n[{section}]\n")
        lines.extend(
            # A JSON string is a TOML basic string.
            f"{name} = {value if isinstance(value, int) else json.dumps(str(value))}\n"
            for name, value in values.items()
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(lines))
    return path
