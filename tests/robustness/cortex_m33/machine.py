"""The C program: built by Debian's compiler for a Cortex-M33, and run in QEMU."""

from __future__ import annotations

import re
import struct
import subprocess
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tests.robustness.cortex_m33.case import Case

ROOT: Final = Path(__file__).parents[3]
SOURCES: Final = ROOT / "sensor_node" / "cortex_m33"
PACKAGES: Final = ("gcc-arm-none-eabi", "libnewlib-arm-none-eabi", "qemu-system-arm")
COMPILER: Final = "arm-none-eabi-gcc"
EMULATOR: Final = "qemu-system-arm"
LISTER: Final = "arm-none-eabi-objdump"
FLAGS: Final = (
    "-mcpu=cortex-m33 -mfpu=fpv5-sp-d16 -mfloat-abi=softfp -std=gnu11 -O3 -ffp-contract=off"
)
"""Single precision in hardware, double precision in software, and no operation merged."""
_LINKING: Final = ("-nostartfiles", "--specs=nosys.specs", "-Wl,--no-warn-rwx-segments")
_SHIFT: Final = 8
_INSTRUCTION_NS: Final = 1 << _SHIFT
"""Emulated ns of an instruction, whichever: what ``-icount shift=8`` means."""
_TICK_NS: Final = 50
"""The timer's, at the machine's 20 MHz."""
_RUN: Final = (
    *(EMULATOR, "-M", "mps2-an505", "-nographic", "-monitor", "none", "-serial", "none"),
    *("-semihosting-config", "enable=on,target=native"),
    *("-icount", f"shift={_SHIFT},sleep=off", "-kernel"),
)
_PATIENCE_S: Final = 600


class MachineError(Exception):
    """The program could not be built or did not run to its end."""


@dataclass(frozen=True, slots=True)
class Result:
    """What a case took and gave.

    Attributes:
        instructions: Between the two looks at the timer, with what a look takes.
        arrays: All its arrays afterwards, one behind the other.
    """

    instructions: int
    arrays: bytes


def install() -> None:
    """Bring compiler and emulator along where they are missing."""
    subprocess.run([ROOT / "services" / "install_test_packages.sh", *PACKAGES], check=True)


def versions() -> dict[str, str]:
    """What builds and runs it."""
    return {
        name: re.sub(r"^\S+ ", "", _said(name, "--version").splitlines()[0])
        for name in (COMPILER, EMULATOR)
    }


def run(cases: Sequence[Case]) -> list[Result]:
    """What each case takes and gives.

    Raises:
        MachineError: The program could not be built, or stopped before its end.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _said(*_RUN, str(_build(folder, cases)), folder=folder)
        return _read((folder / "results.bin").read_bytes(), cases)


@contextmanager
def traced(cases: Sequence[Case]) -> Iterator[tuple[str, Path]]:
    """The program's listing, and a log of every instruction that some cases execute.

    Raises:
        MachineError: The program could not be built, or stopped before its end.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program, log = _build(folder, cases), folder / "executed.log"
        trace = ("-singlestep", "-d", "exec,nochain", "-D", str(log))
        _said(*_RUN[:-1], *trace, "-kernel", str(program), folder=folder)
        yield _said(LISTER, "-d", str(program)), log


def _build(folder: Path, cases: Sequence[Case]) -> Path:
    """The program, and its cases beside it."""
    program = folder / "program.elf"
    sources = sorted(map(str, SOURCES.glob("*.c")))
    _said(COMPILER, *FLAGS.split(), *_LINKING, "-T", str(SOURCES / "machine.ld"), *sources,
          "-o", str(program), "-lm")  # fmt: skip
    (folder / "cases.bin").write_bytes(b"".join(case.encode() for case in cases))
    return program


def _read(results: bytes, cases: Sequence[Case]) -> list[Result]:
    found, at = [], 0
    for case in cases:
        (ticks,) = struct.unpack_from("<I", results, at)
        at += 4
        instructions = round(ticks * _TICK_NS / _INSTRUCTION_NS)
        found.append(Result(instructions, results[at : at + case.size]))
        at += case.size
    if at != len(results):
        raise MachineError(f"{len(results)} bytes of results, where {at} were expected")
    return found


def _said(*command: str, folder: Path | None = None) -> str:
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, timeout=_PATIENCE_S
    )
    if done.returncode != 0:
        raise MachineError(f"{command[0]} failed: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout
