"""Taking turns at a folder of keys, among threads and among processes."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from eskin.errors import LockedError, PrivacyError
from eskin.runtime.files.lock import LockFile

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_PATIENCE_S: Final = 10.0
"""A process that was stopped in its turn must not stop all others for good."""


@contextmanager
def turn(folder: Path) -> Iterator[None]:
    """Have a folder's writing to oneself; whoever has it must not ask for it again.

    Args:
        folder: The folder, on a file system with locks (flock).

    Raises:
        PrivacyError: It cannot be locked, or another one writes there for 10 s.
    """
    try:
        mine = LockFile(folder / ".turn", patience=_PATIENCE_S)
    except LockedError as error:
        raise PrivacyError(f"{folder}: another process keeps it locked") from error
    except OSError as error:
        raise PrivacyError(f"{folder}: cannot be locked: {error.strerror}") from error
    with mine:
        yield
