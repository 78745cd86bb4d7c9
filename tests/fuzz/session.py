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
from typing import TYPE_CHECKING, Any, Final

from tests.fuzz.current import CURRENT, read_current

if TYPE_CHECKING:
    from collections.abc import Callable

MOST_GROWTH_MIB: Final = 96.0
"""Room for libFuzzer's own corpus, and for caches that were not full after a fifth of the run."""
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
        growth_mib: Memory from a fifth of the run to its end.
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
        words = {"--target": self.target, "--inputs": self.inputs, "--seed": self._seed}
        argv = [sys.executable, "-m", "tests.fuzz.child", "--folder", str(self._folder)]
        argv += [str(word) for pair in words.items() for word in pair]
        # In memory, where it is: a disk would rest at each commit of a store.
        memory = _MEMORY if _MEMORY.is_dir() else None
        with log.open("wb") as output, tempfile.TemporaryDirectory(dir=memory) as scratch:
            argv += ["--scratch", scratch]
            child = subprocess.Popen(argv, stdout=output, stderr=subprocess.STDOUT)
            try:
                while child.poll() is None and not self._hangs():
                    tell(self._progress()["inputs"])
                    time.sleep(_LOOK_S)
            finally:
                child.kill()
                child.wait()
        tell(self._progress()["inputs"])
        return self._finding(child.returncode, log.read_text(errors="replace"))

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
            return {"inputs": 0, "seconds": 0.0, "slowest_s": 0.0, "warm_bytes": 0, "bytes": 0}
        found: dict[str, Any] = json.loads(path.read_text())
        return found

    def _finding(self, status: int, said: str) -> Finding:
        progress = self._progress()
        covered = _COVERED.findall(said) or [("0", "0", "0")]
        broken = sorted(self._folder.glob("broken-*"))
        if status and not broken and (self._folder / CURRENT).exists():
            broken = [self._folder / "broken-last"]
            broken[0].write_bytes(read_current(self._folder))
        growth = (progress["bytes"] - progress["warm_bytes"]) / _MIB
        fault = ""
        if status and not broken:
            fault = f"ended with {status}: {said[-2000:]}"
        elif growth > MOST_GROWTH_MIB:
            fault = f"memory grew by {growth:.0f} MiB; at most {MOST_GROWTH_MIB:.0f} are allowed"
        return Finding(
            target=self.target,
            inputs=progress["inputs"],
            rate=progress["inputs"] / max(progress["seconds"], 1e-9),
            paths=int(covered[-1][1]),
            kept=int(covered[-1][2]),
            broken=broken,
            slowest_s=progress["slowest_s"],
            growth_mib=growth,
            said=said[-2000:],
            fault=fault,
        )
