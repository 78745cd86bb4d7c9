"""Taking turns at a folder of keys, among threads and among processes."""

from __future__ import annotations

import fcntl
import os
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from eskin.errors import PrivacyError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_PATIENCE_S: Final = 10.0
_LOOK_S: Final = 0.002


@contextmanager
def turn(folder: Path) -> Iterator[None]:
    """Have a folder's writing to oneself; whoever has it must not ask for it again.

    Each turn opens the lock's file anew, so that it keeps threads apart as it does processes; it
    ends with its process, however that ends. The file, ``.lock``, stays.

    Args:
        folder: The folder, on a file system with locks (flock).

    Raises:
        PrivacyError: It cannot be locked, or another one writes there for 10 s.
    """
    try:
        descriptor = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise PrivacyError(f"{folder}: cannot be locked: {error.strerror}") from error
    try:
        _wait(descriptor, folder)
        yield
    finally:
        os.close(descriptor)


def _wait(descriptor: int, folder: Path) -> None:
    # A process that was stopped in its turn must not stop all others for good.
    latest = time.monotonic() + _PATIENCE_S
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            if time.monotonic() >= latest:
                raise PrivacyError(f"{folder}: another process keeps it locked") from error
            time.sleep(_LOOK_S)
        except OSError as error:
            raise PrivacyError(f"{folder}: cannot be locked: {error.strerror}") from error
        else:
            return
