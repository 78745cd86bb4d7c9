"""Libraries in C that tests put under a process by LD_PRELOAD."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


def build_preload(source: Path, folder: Path) -> Path:
    """Compile one; gives the shared library, in the folder."""
    library = folder / source.with_suffix(".so").name
    options = ["-shared", "-fPIC", "-O2", "-Wall", "-Wextra", "-Werror", "-pthread"]
    subprocess.run(["gcc", *options, "-o", str(library), str(source)], check=True)
    return library
