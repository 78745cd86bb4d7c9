"""Whose turn it is to change a CA's folder: one thread of one process at a time."""

from __future__ import annotations

from contextlib import contextmanager
from threading import RLock
from typing import TYPE_CHECKING, Final

from eskin.errors import AuthorityError, LockedError
from eskin.runtime.files.lock import LockFile

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PATIENCE_S: Final = 10.0
"""Whoever has the turn needs some hundredths of a second, unless it was stopped in the middle."""


class CaLock:
    """What is decided by looking at a CA is done before anybody else may change it.

    Whoever has the turn may take it again: a step may be made of steps.

    Args:
        path: The file that stands for the CA; the lock lies beside it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._thread = RLock()
        self._depth = 0

    @contextmanager
    def take(self) -> Iterator[None]:
        """Wait for the turn, and have it while the block runs.

        Raises:
            LockedError: Somebody else has had it for too long.
            AuthorityError: The folder cannot be written.
        """
        if not self._thread.acquire(timeout=PATIENCE_S):
            raise LockedError(self._path)
        try:
            if self._depth:
                yield
                return
            with self._lock():
                self._depth = 1
                try:
                    yield
                finally:
                    self._depth = 0
        finally:
            self._thread.release()

    def _lock(self) -> LockFile:
        try:
            return LockFile(self._path, patience=PATIENCE_S)
        except OSError as error:
            raise AuthorityError(
                f"{self._path.parent}: the CA's folder cannot be written, so nothing is changed: "
                f"{error.strerror}"
            ) from error
