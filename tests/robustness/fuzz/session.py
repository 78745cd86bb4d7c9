"""A target under libFuzzer, from outside: its process, its progress, and what it found."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final

from tests.robustness.fuzz.current import CURRENT, read_current

if TYPE_CHECKING:
    from collections.abc import Callable

MOST_GROWTH_MIB: Final = 16.0
"""Room for caches that were not full after a fifth of the inputs."""
_GROWTH_SHARE: Final = 0.1
"""So many inputs, of those that are tried, are tried again without instruments."""
HANGS_S: Final = 60.0
"""An input that takes longer, and cannot even be interrupted by libFuzzer's own alarm."""
_LOOK_S: Final = 0.5
_MIB: Final = 2**20
_COVERED: Final = re.compile(r"cov: (\d+) ft: (\d+) corp: (\d+)/")
_MEMORY: Final = Path("/dev/shm")  # noqa: S108 - a folder of our own in it


@dataclass(frozen=True, slots=True)
class Finding:
    """What became of a target.

    Attributes:
        target: Its name.
        inputs: How many were tried.
        rate: In a second.
        paths: Branches and counts of them that were reached.
        kept: Inputs that reached something new.
        broken: Files with inputs that broke the oracle, or hung.
        slowest_s: The slowest input.
        growth_mib: Of memory, in a tenth as many inputs without instruments.
        said: The end of what the process said.
        fault: What else is wrong, or empty.
    """

    target: str
    inputs: int
    rate: float
    paths: int
    kept: int
    broken: list[Path]
    slowest_s: float
    growth_mib: float
    said: str
    fault: str


class Session:
    """One target, in a process of its own.

    Args:
        target: Its name.
        inputs: How many to try.
        seed: Draws them.
        folder: Takes what is found; emptied before.
    """

    def __init__(self, target: str, *, inputs: int, seed: int, folder: Path) -> None:
        self.target = target
        self.inputs = inputs
        self._seed = seed
        self._folder = folder
        self._tried = b""
        self._since = time.monotonic()

    def run(self, *, tell: Callable[[int], None]) -> Finding:
        """Run it to its end, telling how many inputs were tried."""
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir(parents=True)
        log = self._folder / "log"
        with log.open("wb") as output:
            status = self._fuzz(output, tell)
        tell(self._progress()["inputs"])
        growth_mib, status = (0.0, status) if status else self._grow(log)
        return self._finding(status, log.read_text(errors="replace"), growth_mib)

    def _fuzz(self, output: BinaryIO, tell: Callable[[int], None]) -> int:
        with _scratch() as scratch:
            argv = self._argv("tests.robustness.fuzz.child", self.inputs, scratch)
            child = subprocess.Popen(argv, stdout=output, stderr=subprocess.STDOUT)
            try:
                while child.poll() is None and not self._hangs():
                    tell(self._progress()["inputs"])
                    time.sleep(_LOOK_S)
            finally:
                child.kill()
                child.wait()
        return child.returncode

    def _grow(self, log: Path) -> tuple[float, int]:
        """By how many MiB its memory grew, and how that ended."""
        with _scratch() as scratch, log.open("ab") as output:
            argv = self._argv(
                "tests.robustness.fuzz.growth", round(self.inputs * _GROWTH_SHARE), scratch
            )
            done = subprocess.run(argv, stdout=subprocess.PIPE, stderr=output, check=False)
        return (0.0 if done.returncode else int(done.stdout) / _MIB), done.returncode

    def _argv(self, module: str, inputs: int, scratch: str) -> list[str]:
        words = {"--target": self.target, "--inputs": inputs, "--seed": self._seed}
        argv = [sys.executable, "-m", module, "--folder", str(self._folder), "--scratch", scratch]
        return argv + [str(word) for pair in words.items() for word in pair]

    def _hangs(self) -> bool:
        """Whether one input is being tried for too long; it is kept then."""
        current = self._folder / CURRENT
        if not current.exists():
            return False
        data = current.read_bytes()
        if data != self._tried:
            self._tried, self._since = data, time.monotonic()
        hangs = time.monotonic() - self._since > HANGS_S
        if hangs:
            (self._folder / "broken-hang").write_bytes(read_current(self._folder))
        return hangs

    def _progress(self) -> dict[str, Any]:
        path = self._folder / "progress.json"
        if not path.exists():
            return {"inputs": 0, "seconds": 0.0, "slowest_s": 0.0}
        found: dict[str, Any] = json.loads(path.read_text())
        return found

    def _finding(self, status: int, said: str, growth_mib: float) -> Finding:
        progress = self._progress()
        covered = _COVERED.findall(said) or [("0", "0", "0")]
        broken = sorted(self._folder.glob("broken-*"))
        if status and not broken and (self._folder / CURRENT).exists():
            broken = [self._folder / "broken-last"]
            broken[0].write_bytes(read_current(self._folder))
        fault = ""
        if status and not broken:
            fault = f"ended with {status}: {said[-2000:]}"
        elif growth_mib > MOST_GROWTH_MIB:
            fault = f"memory grew by {growth_mib:.0f} MiB, allowed are {MOST_GROWTH_MIB:.0f}"
        return Finding(
            target=self.target,
            inputs=progress["inputs"],
            rate=progress["inputs"] / max(progress["seconds"], 1e-9),
            paths=int(covered[-1][1]),
            kept=int(covered[-1][2]),
            broken=broken,
            slowest_s=progress["slowest_s"],
            growth_mib=growth_mib,
            said=said[-2000:],
            fault=fault,
        )


def _scratch() -> tempfile.TemporaryDirectory[str]:
    """A folder in memory, where there is one: a disk would rest at each commit of a store."""
    return tempfile.TemporaryDirectory(dir=_MEMORY if _MEMORY.is_dir() else None)
