"""Of processes that need a kernel at the same time one compiles, and the others wait for it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.processes import wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator

SOURCE = """
from eskin.kernels.compiled import kernel

@kernel
def half(x):
    return x / 2
"""
ASK = "import sys; from half import half; print(*(half(eval(x)) for x in sys.argv[1:]), flush=True)"
TELL = f"{ASK}; print(sum(half.stats.cache_hits.values()))"
PAUSE = f"""
from half import half
cache = half._cache._cache_file
save = cache._save_data
def pause(*given):
    print("compiled", flush=True)
    input()
    save(*given)
cache._save_data = pause
{ASK}
"""


SLOWEST_S = 200
"""For an interpreter that starts, and compiles a kernel."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Where the kernel lies."""
    (tmp_path / "half.py").write_text(SOURCE)
    return tmp_path


def start(folder: Path, code: str, *values: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", code, *values],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": f"{folder}:{Path(__file__).parents[3]}"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


@pytest.fixture
def first(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Has compiled, written the index, and not yet the code that the index names."""
    with start(folder, PAUSE, "3.0") as process:
        assert process.stdout
        assert process.stdout.readline() == "compiled\n"
        yield process
        process.kill()


def waits(process: subprocess.Popen[str]) -> bool:
    """Whether it waits for a lock, or has ended without one."""
    asked = [line.split() for line in Path("/proc/locks").read_text().splitlines() if "->" in line]
    return process.poll() is not None or str(process.pid) in {fields[5] for fields in asked}


@pytest.mark.parametrize(
    ("value", "said", "kept"), [("5.0", ["2.5", "1"], "1"), ("7", ["3.5", "0"], "2")]
)
def test_second_process_waits_for_the_first_and_compiles_only_what_is_new(
    folder: Path, first: subprocess.Popen[str], value: str, said: list[str], kept: str
) -> None:
    with start(folder, TELL, value) as second:
        wait_until(lambda: waits(second), "the second waits")
        assert first.communicate("\n", timeout=SLOWEST_S)[0] == "1.5\n"
        assert second.communicate(timeout=SLOWEST_S)[0].split() == said
    with start(folder, TELL, "3.0", value) as third:
        assert third.communicate(timeout=SLOWEST_S)[0].split() == ["1.5", said[0], kept]


def test_death_of_the_first_leaves_the_kernel_to_the_second(
    folder: Path, first: subprocess.Popen[str]
) -> None:
    with start(folder, TELL, "5.0") as second:
        wait_until(lambda: waits(second), "the second waits")
        first.kill()
        assert second.communicate(timeout=SLOWEST_S)[0].split() == ["2.5", "0"]
