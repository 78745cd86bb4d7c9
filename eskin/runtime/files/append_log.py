"""Append-only files of lines; a line counts once its end is written."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

from eskin.runtime.files.create import create

if TYPE_CHECKING:
    from pathlib import Path

_STEP: Final = 65_536


def append_lines(path: Path, lines: str) -> None:
    """Write lines at the end, durably.

    A partial line that a power cut or a full disk left is removed first: it was never confirmed,
    and the next line would become part of it. The caller is the only writer.

    Args:
        path: The file, which need not be there yet.
        lines: Whole ones.

    Raises:
        OSError: They cannot be written, or not all of them.
    """
    descriptor, fresh = _opened(path)
    with os.fdopen(descriptor, "ab") as file:
        size = file.seek(0, os.SEEK_END)
        whole = _whole_bytes(path, size)
        if whole < size:
            file.truncate(whole)
        file.write(lines.encode())
        file.flush()
        os.fsync(file.fileno())
    if fresh:
        _sync_folder(path.parent)


def whole_lines(data: bytes) -> list[bytes]:
    """The lines of what was read, without one that has no end."""
    return data[: data.rfind(b"\n") + 1].splitlines(keepends=True)


def _opened(path: Path) -> tuple[int, bool]:
    """A file to append to, and whether it was made for that."""
    try:
        return create(path, mode=0o644), True
    except FileExistsError:
        return os.open(path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC), False


def _whole_bytes(path: Path, size: int) -> int:
    """Up to where the lines of a file are whole."""
    with path.open("rb") as file:
        for end in range(size, 0, -_STEP):
            start = max(end - _STEP, 0)
            file.seek(start)
            found = file.read(end - start).rfind(b"\n")
            if found >= 0:
                return start + found + 1
    return 0


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
