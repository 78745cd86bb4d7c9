"""Room on the disk that is kept back, so that a full disk cannot stop a spool from emptying."""

from __future__ import annotations

import os
from contextlib import suppress
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path

LEAST: Final = 1 / 2
"""The share of the room that has to be regained before it counts as kept back."""


class DiskReserve:
    """A file that only takes room, until the room is needed.

    Deleting from a database takes room, too: without a reserve, a spool whose disk is full can
    never forget what the cloud has taken, and never gets better.

    Args:
        path: The file.
        size: Bytes to keep back.
    """

    def __init__(self, path: Path, *, size: int) -> None:
        self._path = path
        self._size = size
        self.held = False
        self.hold()

    def hold(self) -> bool:
        """Keep the room back, or as much of it as there is; tells whether it is enough."""
        for size in (self._size, int(self._size * LEAST)):
            if self.held:
                break
            self.held = self._allocate(size)
        return self.held

    def release(self) -> bool:
        """Give the room up; tells whether there was any."""
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
