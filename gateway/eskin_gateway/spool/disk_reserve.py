"""Disk space that is reserved so that a spool on a full disk can still delete messages."""

from __future__ import annotations

import os
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


class DiskReserve:
    """A file that only takes space, until the space is needed.

    Deleting rows needs space, too: without a reserve, a spool on a full disk could not delete what
    the cloud has stored.

    Args:
        path: The file.
        size: Bytes to reserve. Half of them are enough.
    """

    def __init__(self, path: Path, *, size: int) -> None:
        self._path = path
        self._size = size
        self.held = False
        self.hold()

    def hold(self) -> bool:
        """Reserve the space if it is not held; return whether it is held now."""
        for size in (self._size, self._size // 2):
            self.held = self.held or self._allocate(size)
        return self.held

    def release(self) -> bool:
        """Release the space; return whether it was held."""
        held, self.held = self.held, False
        self._path.unlink(missing_ok=True)
        return held

    def _allocate(self, size: int) -> bool:
        try:
            descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError:
            return False
        try:
            os.posix_fallocate(descriptor, 0, size)
            os.ftruncate(descriptor, size)
        except OSError:
            with suppress(OSError):
                self._path.unlink()
            return False
        finally:
            os.close(descriptor)
        return True
