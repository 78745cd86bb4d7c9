"""Configuration files of all processes."""

from __future__ import annotations

import os
from contextlib import ExitStack
from typing import TYPE_CHECKING
from unittest.mock import patch

from eskin_ca.settings import CaSettings
from eskin_cloud.settings import CloudSettings
from eskin_gateway.settings import GatewaySettings
from eskin_sensor_node.profile import Profile, profile_names
from eskin_sensor_node.settings import NodeSettings

from eskin.errors import SettingsError
from tests.robustness.fuzz.mutations.texts import mutate_text
from tests.robustness.fuzz.target import Target

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.runtime.settings import Settings

CLASSES: tuple[type[Settings], ...] = (
    NodeSettings,
    GatewaySettings,
    CloudSettings,
    CaSettings,
)
NODE = """
[node]
name = "fingertip"
profile = "own"
[identity]
directory = "keys"
site = "site.pem"
[flash]
path = "flash.db"
[truth]
path = "truth.db"
"""
GATEWAY = """
[broker]
host = "b"
port = 8883
group = "g"
[identity]
directory = "k"
site = "s"
[cloud]
url = "https://c:8443/api/v1/ingest"
[spool]
path = "spool.db"
"""
CLOUD = """
[store]
path = "s.sqlite"
[people]
host = "127.0.0.1"
port = 8080
[gateways]
identity = "keys"
uploads_bytes = 134217728
[limits]
body_bytes = 65536
"""
AUTHORITY = """
[ca]
directory = "ca"
port = 8444
names = ["localhost"]
[[identity]]
kind = "node"
name = "palm"
site = "site.main"
directory = "palm"
"""
FILES = (
    NODE.replace('"own"', '"fingertip"') + '[sampling]\nencoding = "f64"\n[fleet]\ncount = 3\n',
    GATEWAY,
    CLOUD,
    AUTHORITY,
)


def make(folder: Path) -> Target:
    """The input is the number of a process, and its file: only `SettingsError`, in one line."""
    path = folder / "settings.toml"

    def check(data: bytes) -> None:
        settings = CLASSES[sum(data[:1]) % len(CLASSES)]
        path.write_bytes(data[1:])
        try:
            settings.load(path)
        except SettingsError as error:
            require_line(str(error))

    designs = [NODE + Profile.read(name).text for name in profile_names()]
    texts = [*enumerate(FILES), *((0, text) for text in designs)]
    first = ord("0")  # which the number of processes divides
    seeds = tuple(bytes([first + number]) + text.encode() for number, text in texts)
    return Target(seeds, mutate_text, check, bare_environment())


def bare_environment() -> ExitStack:
    """An environment without variables until it is closed: each load goes through all of them."""
    stack = ExitStack()
    stack.enter_context(patch.dict(os.environ, clear=True))
    return stack


def require_line(text: str) -> None:
    """Check what a user is stated."""
    assert "Traceback" not in text
    assert len(text) < 4000, text
