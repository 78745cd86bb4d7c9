"""What a process did to the files of a folder, in its order."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from tests.support.preloads import build_preload

if TYPE_CHECKING:
    from collections.abc import Iterator

_HEAD: Final = struct.Struct("=IIQQ")
_SOURCE: Final = Path(__file__).with_name("journal.c")
_MARKS: Final = "marks"


class Deed(NamedTuple):
    """One call.

    Attributes:
        name: ``w`` write, ``t`` truncate, ``s`` synchronise, ``u`` unlink.
        path: Of the file, or of the folder itself.
        offset: Where it was written; or the size that it was truncated to.
        data: What was written.
    """

    name: str
    path: Path
    offset: int
    data: bytes

    @property
    def mark(self) -> list[Any] | None:
        """What the process stated about itself at this instant, if it did."""
        if self.path.name != _MARKS:
            return None
        stated: list[Any] = json.loads(self.data)
        return stated


class Marks:
    """Lets a process tell what it has done: ``[what, of which]``.

    Args:
        folder: The one whose journal is kept.
    """

    def __init__(self, folder: Path) -> None:
        self._file = os.open(folder / _MARKS, os.O_WRONLY | os.O_CREAT)

    def tell(self, what: str, *which: Any) -> None:
        """Tell it."""
        os.write(self._file, json.dumps([what, which]).encode())


def record(folder: Path, *, seed: int) -> Path:
    """Let a process work on each store, in a folder of its name.

    Args:
        folder: An empty one; takes them all.
        seed: Draws what it does.

    Returns:
        The journal.
    """
    outside = folder.parent
    journal = outside / f"{folder.name}.journal"
    environment = os.environ | {
        "LD_PRELOAD": str(build_preload(_SOURCE, outside)),
        "JOURNAL": str(journal),
        "JOURNAL_OF": str(folder),
    }
    words = [sys.executable, "-m", "tests.robustness.powercut.work", str(folder), str(seed)]
    root = Path(__file__).parents[3]
    subprocess.run(words, env=environment, cwd=root, check=True)
    return journal


def read_journal(file: Path, folder: Path) -> Iterator[Deed]:
    """What was done in one folder, in order."""
    journal = file.read_bytes()
    at = 0
    while at < len(journal):
        deed, path, offset, length = _HEAD.unpack_from(journal, at)
        at += _HEAD.size
        where = Path(os.fsdecode(journal[at : at + path]))
        at += path
        # An fd of a file that was unlinked meanwhile: no one finds it again.
        if folder in {where, where.parent} and not where.name.endswith(" (deleted)"):
            yield Deed(chr(deed), where, offset, journal[at : at + length])
        at += length
