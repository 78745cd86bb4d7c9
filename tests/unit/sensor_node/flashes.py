"""Flashes under a key that this run of the tests has drawn."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

from eskin_sensor_node.machine.flash.flash import Flash

from eskin.privacy.subject import KEY_BYTES

if TYPE_CHECKING:
    from pathlib import Path

NODE = "fingertip"
KEY = os.urandom(KEY_BYTES)


def open_flash(path: Path, *, epoch: int | None = 1, node: str = NODE, key: bytes = KEY) -> Flash:
    """The flash of a node."""
    return Flash(path, node=node, key=key, epoch=epoch)


def on_disk(folder: Path) -> bytes:
    """All bytes of all files of a folder, but keys."""
    return b"".join(path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file())


def change(path: Path, statement: str, *values: object) -> None:
    """Change a file behind its owner's back."""
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute(statement, values)
