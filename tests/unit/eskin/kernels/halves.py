"""A kernel in a folder of its own, and processes that use it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Final

SOURCE: Final = """
from eskin.kernels.jit import kernel

@kernel
def half(x):
    return x / 2
"""
ASK: Final = (
    "import sys; from half import half; print(*(half(eval(x)) for x in sys.argv[1:]), flush=True)"
)
TELL: Final = f"{ASK}; print(sum(half.stats.cache_hits.values()))"
"""Prints halves, and how many signatures were compiled before."""
SLOWEST_S: Final = 200
"""For an interpreter that starts, and compiles a kernel."""


def write_kernel(folder: Path) -> Path:
    """Put the kernel into a folder; gives its file."""
    file = folder / "half.py"
    file.write_text(SOURCE)
    return file


def start(folder: Path, code: str, *values: str) -> subprocess.Popen[str]:
    """Run code beside the kernel."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *values],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": f"{folder}:{Path(__file__).parents[4]}"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def tell(folder: Path, *values: str) -> list[str]:
    """Halves, and how many signatures were compiled before."""
    with start(folder, TELL, *values) as process:
        said = process.communicate(timeout=SLOWEST_S)[0].split()
    assert process.returncode == 0
    return said
