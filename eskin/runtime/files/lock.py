"""Lock files: one process, and one thread of it, at a time."""

from __future__ import annotations

import fcntl
import os
import time
from contextlib import contextmanager
from threading import RLock
from typing import TYPE_CHECKING, Final, Self

from eskin.errors import AuthorityError, LockedError, PrivacyError
from eskin.runtime.files.create import create, make_folder

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PATIENCE_S: Final = 10.0
"""A writer needs some hundredths of a second, unless its process is stopped."""
_PAUSE_S: Final = 0.005


class LockFile:
    """An exclusive lock (flock), held until it is closed or its process ends in any way.

    The lock is the file ``NAME.lock`` beside the locked one. It is never removed: removing a held
    lock would let a second process in.

    Args:
        path: The file to lock; its folder is made if missing.
        patience: Seconds to wait for the present owner.

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
        """Release the lock."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _wait(self, path: Path, deadline: float) -> None:
        """Poll: a blocking call in the kernel has no timeout."""
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


class ReentrantLock:
    """A lock among threads and processes, which its holder may take again.

    Args:
        path: The file that stands for the CA; the lock lies beside it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._thread = RLock()
        self._depth = 0

    @contextmanager
    def take(self) -> Iterator[None]:
        """Hold the lock while the block runs.

        Raises:
            LockedError: Another thread or process held it for `PATIENCE_S`.
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


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Lock a folder of keys for writing; not reentrant.

    Raises:
        PrivacyError: The folder cannot be locked, or another writer held it for `PATIENCE_S`.
    """
    try:
        held = LockFile(folder / ".writer", patience=PATIENCE_S)
    except LockedError as error:
        raise PrivacyError(f"{folder}: another process keeps it locked") from error
    except OSError as error:
        raise PrivacyError(f"{folder}: cannot be locked: {error.strerror}") from error
    with held:
        yield


def _opened(lock: Path) -> int:
    try:
        return create(lock, mode=0o600)
    except FileExistsError:
        return os.open(lock, os.O_RDWR | os.O_CLOEXEC)
