"""Cutting the power, at one instant after the other of what a store did."""

from __future__ import annotations

import random
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from tests.robustness.powercut.disk import Disk
from tests.robustness.powercut.journal import read_journal
from tests.robustness.powercut.stores import STORES

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tests.robustness.powercut.journal import Deed

_LOG: Final = "-wal"
_FAST: Final = Path("/dev/shm")  # noqa: S108 - a fresh folder in it
"""Where what a cut has left is opened: no one waits for a disk there."""
_RARE: Final = 8
"""How much likelier a cut is where a file is folded, synchronised or removed."""


class Cut(NamedTuple):
    """An instant at which the power failed, and what went wrong then (``None``: nothing)."""

    deed: int
    fault: str | None


def cut(name: str, folder: Path, journal: Path, *, images: int, seed: int) -> Iterator[Cut]:
    """Cut a store's power in so many ways, and open what is left.

    Args:
        name: Of the store.
        folder: In which it has worked.
        journal: What was done there.
        images: How many ways.
        seed: Draws the instants, and what survives.
    """
    deeds = list(read_journal(journal, folder))
    draw = random.Random(seed)  # noqa: S311 - a plan, no secret
    disk, marks = Disk(folder), list[list[Any]]()
    instants = sorted(_instants(deeds, draw, images), reverse=True)
    with tempfile.TemporaryDirectory(dir=_FAST if _FAST.is_dir() else None) as left:
        for number, deed in enumerate(deeds):
            while instants and instants[-1] == number:
                instants.pop()
                yield Cut(number, _open(name, Path(left) / "left", disk.cut(draw), marks))
            if deed.mark is not None:
                marks.append(deed.mark)
            else:
                disk.take(deed)
    _require_whole(disk, folder)


def _instants(deeds: Sequence[Deed], draw: random.Random, images: int) -> list[int]:
    weights = [
        1 if deed.name == "w" and (deed.mark or deed.path.name.endswith(_LOG)) else _RARE
        for deed in deeds
    ]
    return draw.choices(range(len(deeds)), weights, k=images)


def _open(name: str, folder: Path, files: dict[str, bytes], marks: list[list[Any]]) -> str | None:
    folder.mkdir()
    try:
        for file, content in files.items():
            (folder / file).write_bytes(content)
        STORES[name].check(folder, marks)
    except Exception as error:  # noqa: BLE001 - whatever goes wrong is what we look for
        return f"{type(error).__name__}: {error}"
    finally:
        shutil.rmtree(folder)
    return None


def _require_whole(disk: Disk, folder: Path) -> None:
    """With power to the end the files are those of the process: no call went by the journal."""
    whole = disk.whole()
    assert whole, "the journal is empty"
    for name, content in whole.items():
        assert content == (folder / name).read_bytes(), name
