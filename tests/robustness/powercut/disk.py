"""A disk whose power may fail: what was synchronised stays, and of the rest anything may."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import random
    from collections.abc import Iterator
    from pathlib import Path

    from tests.robustness.powercut.journal import Deed

_SECTOR: Final = 512
_SHARED_MEMORY: Final = "-shm"
"""SQLite's index of the log is memory that happens to have a name: after a cut it is noise."""


@dataclass(slots=True)
class File:
    """Contents: what surely stays, and what was done since."""

    safe: bytearray = field(default_factory=bytearray)
    since: list[Deed] = field(default_factory=list)

    def synchronise(self) -> None:
        """All of it stays from here on."""
        for deed in self.since:
            apply(self.safe, deed)
        self.since.clear()

    def survive(self, draw: random.Random) -> bytes:
        """What is left after a cut."""
        left = bytearray(self.safe)
        for deed in _surviving(self.since, draw):
            apply(left, deed)
        return bytes(left)


class Disk:
    """The files of one folder.

    Names are as strict as POSIX: until the folder itself is synchronised, a new file may have
    vanished, and one that was removed may be back.

    Args:
        folder: The folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._files: dict[Path, File] = {}
        self._safe_names: dict[Path, File] = {}
        self._renamed: list[tuple[Path, File | None]] = []

    def take(self, deed: Deed) -> None:
        """Do what a process did."""
        if deed.name == "u":
            del self._files[deed.path]
            self._renamed.append((deed.path, None))
        elif deed.name == "s" and deed.path == self._folder:
            _rename(self._safe_names, self._renamed)
            self._renamed.clear()
        elif deed.name == "s":
            self._file(deed.path).synchronise()
        else:
            self._file(deed.path).since.append(deed)

    def whole(self) -> dict[str, bytes]:
        """The files as the process sees them."""
        found = {}
        for path, file in self._files.items():
            content = bytearray(file.safe)
            for deed in file.since:
                apply(content, deed)
            found[path.name] = bytes(content)
        return found

    def cut(self, draw: random.Random) -> dict[str, bytes]:
        """The files that are left when the power fails now; one of the many ways."""
        names = dict(self._safe_names)
        _rename(names, self._renamed[: draw.randint(0, len(self._renamed))])
        return {
            path.name: draw.randbytes(len(file.safe) or 32_768)
            if path.name.endswith(_SHARED_MEMORY)
            else file.survive(draw)
            for path, file in names.items()
        }

    def _file(self, path: Path) -> File:
        if path not in self._files:
            self._files[path] = File()
            self._renamed.append((path, self._files[path]))
        return self._files[path]


def apply(content: bytearray, deed: Deed) -> None:
    """Do to contents what was done to the file."""
    if deed.name == "t":
        del content[deed.offset :]
    if len(content) < deed.offset:
        content.extend(bytes(deed.offset - len(content)))
    content[deed.offset : deed.offset + len(deed.data)] = deed.data


def _surviving(since: list[Deed], draw: random.Random) -> Iterator[Deed]:
    """None, all, the first ones up to a byte, or any of the sectors, each up to a byte."""
    manner = draw.choice(("none", "all", "first", "sectors"))
    if manner == "all":
        yield from since
    elif manner == "first" and since:
        last = draw.randrange(len(since))
        yield from since[:last]
        yield _torn(since[last], draw)
    elif manner == "sectors":
        for deed in since:
            for part in _sectors(deed):
                if draw.random() < 0.5:
                    yield part if draw.random() < 0.9 else _torn(part, draw)


def _torn(deed: Deed, draw: random.Random) -> Deed:
    return deed._replace(data=deed.data[: draw.randint(0, len(deed.data))])


def _sectors(deed: Deed) -> Iterator[Deed]:
    if deed.name == "t":
        yield deed
    first, end = deed.offset, deed.offset + len(deed.data)
    while first < end:
        last = min(end, (first // _SECTOR + 1) * _SECTOR)
        data = deed.data[first - deed.offset : last - deed.offset]
        yield deed._replace(offset=first, data=data)
        first = last


def _rename(names: dict[Path, File], renamed: list[tuple[Path, File | None]]) -> None:
    for path, file in renamed:
        if file is None:
            names.pop(path, None)
        else:
            names[path] = file
