"""Private files: made once, replaced atomically, overwritten before removal."""

from __future__ import annotations

import os
import re
import secrets
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from eskin.errors import PrivacyError
from eskin.runtime.files import create
from eskin.runtime.files.lock import locked_folder

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_PARTIAL: Final = re.compile(r"\..+\.[0-9a-f]{8}")


def make_folder(path: Path) -> None:
    """Make a folder for its owner alone.

    Raises:
        PrivacyError: It cannot be made.
    """
    try:
        create.make_folder(path)
    except OSError as error:
        raise PrivacyError(f"{path}: cannot be made: {error.strerror}") from error


def read_private(path: Path) -> bytes:
    """Read a file with mode 0600.

    Raises:
        PrivacyError: It cannot be read, or others may.
    """
    try:
        if path.stat().st_mode & 0o077:
            raise PrivacyError(f"{path}: others may read this key; chmod 600 it")
        return path.read_bytes()
    except OSError as error:
        raise PrivacyError(f"{path}: cannot be read: {error.strerror}") from error


def write_private(path: Path, data: bytes) -> None:
    """Replace a file at once, mode 0600, durably; what could not be put in place is destroyed.

    Raises:
        PrivacyError: It cannot be written.
    """
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        _write(partial, data)
        partial.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        with suppress(PrivacyError):  # `partials` finds it later
            destroy(partial)
        raise PrivacyError(f"{path}: cannot be written: {error.strerror}") from error


def make_once(path: Path, make: Callable[[], bytes]) -> bytes:
    """What a file holds; made where there is none, and by one alone where several make it.

    Raises:
        PrivacyError: It cannot be read or made.
    """
    if not path.exists():
        with locked_folder(path.parent):
            if not path.exists():
                write_private(path, make())
    return read_private(path)


def partials(folder: Path) -> list[Path]:
    """Files that a power cut left unfinished, or that are being written now.

    The holder of the folder's lock (`locked_folder`) sees only the former.
    """
    return [path for path in folder.iterdir() if _PARTIAL.fullmatch(path.name)]


def destroy(path: Path) -> None:
    """Overwrite a file with noise, in place, then remove it; durably.

    A file system or a disk that writes elsewhere (snapshots, flash) may keep the old bytes.

    Raises:
        PrivacyError: It cannot be written.
    """
    try:
        if path.stat().st_nlink == 1:
            _overwrite(path)
        path.unlink()
        sync_folder(path.parent)
    except FileNotFoundError:
        return
    except OSError as error:
        raise PrivacyError(f"{path}: cannot be destroyed: {error.strerror}") from error


def sync_folder(path: Path) -> None:
    """Make names in a folder durable."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _overwrite(path: Path) -> None:
    with path.open("r+b") as file:
        file.write(os.urandom(path.stat().st_size))
        file.flush()
        os.fsync(file.fileno())


def _write(path: Path, data: bytes) -> None:
    descriptor = create.create(path, mode=0o600)
    with os.fdopen(descriptor, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
