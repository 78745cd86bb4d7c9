"""Noticing that a file was replaced."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

Version = tuple[int, int, int]
"""What differs once a file was replaced: time, size, inode."""


def version(path: Path) -> Version:
    """Of a file as it is now.

    Raises:
        OSError: It cannot be looked at.
    """
    found = path.stat()
    return found.st_mtime_ns, found.st_size, found.st_ino
