"""How scripts and other MQTT clients join the demo: ``access.json``, for the owner's eyes only."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from eskin.demo.identities import CLIENT
from eskin.demo.ports import LOOPBACK
from eskin.identity.identity import CHAIN_FILE, KEY_FILE, ROOT_FILE, write_whole

if TYPE_CHECKING:
    from eskin.demo.layout import DemoFolder
    from eskin.demo.settings_files import Ports


def write_access(layout: DemoFolder, ports: Ports, token: str) -> None:
    """Write the file, mode 0600.

    Raises:
        OSError: It cannot be written.
    """
    client = layout.identity(CLIENT)
    content = {
        "url": f"http://{LOOPBACK}:{ports.people}",
        "token": token,
        "mqtt": {
            "host": LOOPBACK,
            "port": ports.broker.clients,
            "ca": str(client / ROOT_FILE),
            "cert": str(client / CHAIN_FILE),
            "key": str(client / KEY_FILE),
        },
    }
    write_whole(layout.access, json.dumps(content, indent=2).encode() + b"\n", mode=0o600)
