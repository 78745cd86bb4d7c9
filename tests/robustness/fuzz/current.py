"""The input that is being tried, in a file that outlives the process that tries it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path

CURRENT: Final = "current"
"""Name of the file: the input's length, then the input."""
LENGTH_BYTES: Final = 4
LONGEST: Final = 65_536
"""Bytes of an input."""


def read_current(folder: Path) -> bytes:
    """The input that was tried last."""
    data = (folder / CURRENT).read_bytes()
    return data[LENGTH_BYTES:][: int.from_bytes(data[:LENGTH_BYTES])]
