"""Of processes that need a kernel at the same time one compiles, and the others wait for it."""

from __future__ import annotations

import signal
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.support.processes import wait_until
from tests.unit.eskin.kernels.halves import ASK, SLOWEST_S, TELL, start, tell, write_kernel

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Iterator

PAUSE = f"""
from half import half
cache = half._cache._cache_file
save = cache.save
def pause(*given):
    print("compiled", flush=True)
    input()
    save(*given)
cache.save = pause
{ASK}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Where the kernel lies."""
    write_kernel(tmp_path)
    return tmp_path


@pytest.fixture
def first(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Has compiled, and not yet written."""
    with start(folder, PAUSE, "3.0") as process:
        assert process.stdout
        assert process.stdout.readline() == "compiled\n"
        yield process
        process.kill()


def waits(process: subprocess.Popen[str]) -> bool:
    """Whether it has opened a lock, or has ended without one."""
    if process.poll() is not None:
        return True
    opened = []
    for each in Path(f"/proc/{process.pid}/fd").iterdir():
        with suppress(OSError):
            opened.append(each.readlink())
    return any(each.suffix == ".lock" for each in opened)


@pytest.mark.nightly
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
    assert tell(folder, "3.0", value) == ["1.5", said[0], kept]


@pytest.mark.nightly
def test_death_of_the_first_leaves_the_kernel_to_the_second(
    folder: Path, first: subprocess.Popen[str]
) -> None:
    with start(folder, TELL, "5.0") as second:
        wait_until(lambda: waits(second), "the second waits")
        first.kill()
        assert second.communicate(timeout=SLOWEST_S)[0].split() == ["2.5", "0"]


@pytest.mark.nightly
def test_process_that_is_stopped_while_it_compiles_is_not_waited_for(
    folder: Path, first: subprocess.Popen[str]
) -> None:
    first.send_signal(signal.SIGSTOP)
    impatient = f"from eskin.kernels import jit_cache\njit_cache.MOST_WAIT_S = 0.2\n{TELL}"
    with start(folder, impatient, "5.0") as second:
        assert second.communicate(timeout=SLOWEST_S)[0].split() == ["2.5", "0"]
    first.send_signal(signal.SIGCONT)
    assert first.communicate("\n", timeout=SLOWEST_S)[0] == "1.5\n"
