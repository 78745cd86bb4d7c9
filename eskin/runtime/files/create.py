"""Files that root makes belong to their folder's owner, so that the service can use them."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


def give_to_owner(made: int, folder: Path) -> None:
    """Give what root has just made to the owner of the folder in which it lies.

    Args:
        made: Its file descriptor, as opened with ``O_EXCL``: another could be a link to anything.
        folder: Where it lies.

    Raises:
        OSError: It cannot be given.
    """
    if os.geteuid() == 0:
        owner = folder.stat()
        os.fchown(made, owner.st_uid, owner.st_gid)


def make_folder(path: Path, *, mode: int = 0o700) -> None:
    """Make a folder where there is none, and those above it.

    Args:
        path: The folder.
        mode: Its rights; those above it have what is usual.

    Raises:
        OSError: It cannot be made.
    """
    if path.is_dir():
        return
    make_folder(path.parent, mode=0o777)
    try:
        path.mkdir(mode=mode)
    except FileExistsError:
        if not path.is_dir():
            raise
        return  # another process was first
    made = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        give_to_owner(made, path.parent)
    finally:
        os.close(made)


def create(path: Path, *, mode: int) -> int:
    """Open a file for writing that is not there yet; gives its file descriptor.

    Args:
        path: The file.
        mode: Its rights.

    Raises:
        FileExistsError: There is something already.
        OSError: It cannot be made.
    """
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
    made = os.open(path, flags, mode)
    try:
        give_to_owner(made, path.parent)
    except OSError:
        os.close(made)
        path.unlink(missing_ok=True)
        raise
    return made
