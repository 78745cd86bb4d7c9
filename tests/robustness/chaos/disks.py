"""Small disks that can be filled: a tmpfs for each store."""

from __future__ import annotations

import subprocess
from contextlib import suppress
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path

_PIECE: Final = 1 << 16


class Disk:
    """A file system of its own, mounted in the caller's mount namespace.

    Args:
        folder: Where; made if missing.
        size: Bytes.
    """

    def __init__(self, folder: Path, size: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
        subprocess.run(mount, check=True)
        self.folder = folder
        self._other = folder / "foreign-file"

    def unmount(self) -> None:
        """Take it away, with all that is on it."""
        subprocess.run(["umount", "--lazy", str(self.folder)], check=True)

    def fill(self) -> None:
        """Take all that is free."""
        for piece in (_PIECE, 4096, 1):
            with self._other.open("ab", buffering=0) as other, suppress(OSError):
                while other.write(bytes(piece)) == piece:
                    pass

    def free(self) -> None:
        """Give it back."""
        self._other.unlink(missing_ok=True)
