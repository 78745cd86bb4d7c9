"""One target under libFuzzer (atheris): what reaches new code is kept and changed again.

Run by ``tests.robustness.fuzz.__main__``, a process for each target, as libFuzzer ends its process.
"""

from __future__ import annotations

import argparse
import json
import mmap
import sys
import time
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Final

import atheris

from tests.robustness.fuzz.current import CURRENT, LENGTH_BYTES, LONGEST
from tests.robustness.fuzz.target import load

if TYPE_CHECKING:
    from tests.robustness.fuzz.target import Target

SLOWEST_S: Final = 30
"""An input that takes longer is a hang."""
_OURS: Final = ("eskin", "eskin_cloud", "eskin_gateway", "eskin_ca", "eskin_sensor_node")
_NUMERIC: Final = (
    "eskin.kernels",
    "eskin.interval",
    "eskin.models",
    "eskin.peaks",
    "eskin_sensor_node.firmware",
    "eskin_sensor_node.fleet",
    "eskin_sensor_node.machine",
)


@dataclass
class Progress:
    """What the parent is stated.

    Attributes:
        inputs: Tried so far.
        seconds: Since the first.
        slowest_s: The slowest input.
    """

    inputs: int = 0
    seconds: float = 0.0
    slowest_s: float = 0.0


class Trial:
    """Counts and measures what libFuzzer tries.

    Args:
        target: What it tries it on.
        inputs: How many.
        folder: Takes ``progress.json`` and the slowest input.
    """

    def __init__(self, target: Target, *, inputs: int, folder: Path) -> None:
        self._target = target
        self._inputs = inputs
        self._folder = folder
        self._start = time.perf_counter()
        self._step = max(1, inputs // 200)
        self._progress = Progress()
        path = folder / CURRENT
        path.write_bytes(bytes(LENGTH_BYTES + LONGEST))
        with path.open("r+b") as file:
            self._current = mmap.mmap(file.fileno(), 0)

    def try_one(self, data: bytes) -> None:
        """Try an input."""
        progress = self._progress
        # Should it never end, the parent finds it here.
        self._current[: LENGTH_BYTES + len(data)] = len(data).to_bytes(LENGTH_BYTES) + data
        begin = time.perf_counter()
        self._target.check(data)
        took = time.perf_counter() - begin
        if took > progress.slowest_s and progress.inputs > len(self._target.seeds):
            progress.slowest_s = took
            (self._folder / "slowest").write_bytes(data)
        progress.inputs += 1
        if progress.inputs % self._step == 0 or progress.inputs == self._inputs:
            self._tell()

    def change(self, data: bytes, most: int, seed: int) -> bytes:
        """Change an input, knowing how it is made; every fourth time as libFuzzer would."""
        random = Random(seed)
        if random.random() < 0.25:
            changed: bytes = atheris.Mutate(data, most)
            return changed
        return self._target.mutate(data, random)[:most]

    def _tell(self) -> None:
        progress = self._progress
        progress.seconds = time.perf_counter() - self._start
        fresh = self._folder / "progress.tmp"
        fresh.write_text(json.dumps(asdict(progress)))
        fresh.replace(self._folder / "progress.json")


def _compiled() -> list[str]:
    """Modules that numba compiles: it does not know what instruments them."""
    names = []
    for package in _OURS:
        for place in find_spec(package).submodule_search_locations:  # type: ignore[union-attr]
            for path in Path(place).rglob("*.py"):
                within = path.relative_to(place).with_suffix("").parts
                name = ".".join((package, *within))
                if name.startswith(_NUMERIC) or "eskin.kernels" in path.read_text():
                    names.append(name.removesuffix(".__init__"))
    return names


def main() -> None:
    """Fuzz one target, or try one file again."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--target", required=True)
    parser.add_argument("--inputs", type=int, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--scratch", type=Path, required=True, help="for the target's own files")
    options = parser.parse_args()
    corpus = options.folder / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    with atheris.instrument_imports(include=_OURS, exclude=_compiled()):
        target = load(options.target, options.scratch)
    for number, seed in enumerate(target.seeds):
        target.check(seed)  # what it needs is compiled now, which may take longer than an input may
        (corpus / f"seed-{number}").write_bytes(seed)
    trial = Trial(target, inputs=options.inputs, folder=options.folder)
    flags = {
        "runs": options.inputs,
        "seed": options.seed,
        "max_len": target.longest,
        "timeout": SLOWEST_S,
        "report_slow_units": SLOWEST_S,
        "rss_limit_mb": 0,
        "artifact_prefix": f"{options.folder}/broken-",
        "print_final_stats": 1,
    }
    argv = [sys.argv[0], *(f"-{name}={value}" for name, value in flags.items()), str(corpus)]
    atheris.Setup(argv, trial.try_one, custom_mutator=trial.change)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
