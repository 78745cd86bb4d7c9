"""Clocks that jump: a process's real-time clock is moved, and its monotonic one stays true."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

from tests.support.preloads import build_preload

_SOURCE: Final = Path(__file__).with_name("wallclock.c")


class Wallclock:
    """The real-time clock of one process.

    Args:
        file: Holds how far off it is.
        library: As `build_library` made it.
    """

    def __init__(self, file: Path, library: Path) -> None:
        self._file = file
        self._library = library
        file.write_bytes(struct.pack("=q", 0))

    @property
    def environment(self) -> dict[str, str]:
        """Variables with which the process must start."""
        return {"LD_PRELOAD": str(self._library), "WALLCLOCK": str(self._file)}

    def set(self, seconds: int) -> None:
        """Let it be off by so many seconds from now on."""
        with self._file.open("r+b") as file:  # written in place: the process has it mapped
            file.write(struct.pack("=q", seconds))


def build_library(folder: Path) -> Path:
    """Compile what moves clocks; gives the shared library."""
    return build_preload(_SOURCE, folder)
