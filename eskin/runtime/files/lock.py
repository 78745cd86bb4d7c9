"""A lock file: what one process owns, no other may write."""

from __future__ import annotations

import fcntl
import os
import time
from typing import TYPE_CHECKING, Final, Self

from eskin.errors import LockedError
from eskin.runtime.files.create import create, make_folder

if TYPE_CHECKING:
    from pathlib import Path

_PAUSE_S: Final = 0.005


class LockFile:
    """Holds a file for this process until it is closed or the process ends, however it ends.

    The lock lies beside the file, as ``NAME.lock``, and stays there: whoever removes it while it is
    held lets a second process in.

    Args:
        path: The file to own; its folder is made if missing.
        patience: Seconds for which to wait until the owner lets go.

    Raises:
        LockedError: Another process, or another `LockFile` of this one, owns it.
        OSError: The folder cannot be made or written.
    """

    def __init__(self, path: Path, *, patience: float = 0.0) -> None:
        make_folder(path.parent)
        self._descriptor = _opened(path.with_name(f"{path.name}.lock"))
        try:
            self._wait(path, time.monotonic() + patience)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let go."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _wait(self, path: Path, deadline: float) -> None:
        """Asked again and again: a call that waits in the kernel could wait for ever."""
        while True:
            try:
                fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                if time.monotonic() >= deadline:
                    raise LockedError(path) from error
                time.sleep(_PAUSE_S)
            else:
                return

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _opened(lock: Path) -> int:
    try:
        return create(lock, mode=0o600)
    except FileExistsError:
        return os.open(lock, os.O_RDWR | os.O_CLOEXEC)
