"""``make nightly``: every long check, one after the other, with a table at the end.

Each step's output goes to ``build/nightly/STEP.log``. A step that fails ends no other. Exit
status 1 if one failed.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

from tests.support.citus import NO_SOURCE, PROGRAMS, SOURCE

STEPS: Final = {
    "lint": ["make", "lint"],
    "test": ["make", "test", "ARGS=--hypothesis-profile=hunt -m 'not compose'"],
    "planted": [".venv/bin/python", "-m", "tests.robustness.planted"],
    "chaos-sqlite": ["make", "chaos", "ARGS=--duration 300 --seed {seed}"],
    "chaos-postgresql": ["make", "chaos", "ARGS=--duration 300 --seed {seed} --store postgresql"],
    "chaos-cluster": ["make", "chaos", "ARGS=--duration 300 --seed {seed} --cluster"],
    "chaos-citus": [
        *("make", "chaos", "ARGS=--duration 300 --seed {seed} --citus", "SOURCE={source}")
    ],
    "test-cluster": ["make", "test-cluster", "SOURCE={source}"],
    "model": ["make", "model", "ARGS=--large --seconds 3600"],
    "model-mutants": ["make", "model", "ARGS=--mutants"],
    "simulate": ["make", "simulate", "ARGS=--seeds 3000 --count 12 --first {seed}000"],
    "powercut": ["make", "powercut", "ARGS=--images 500 --seed {seed}"],
    "interleavings": [
        *(".venv/bin/python", "-m", "tests.robustness.interleavings", "--seed", "{seed}")
    ],
    "fuzz": ["make", "fuzz", "ARGS=--inputs 100000 --seed {seed}"],
    "bitflips": [
        *(
            ".venv/bin/python",
            "-m",
            "tests.robustness.bitflips",
            "--flips",
            "1000",
            "--seed",
            "{seed}",
        )
    ],
    "boxes": [
        ".venv/bin/python",
        "-m",
        "tests.robustness.boxes",
        "--count",
        "4000",
        "--seed",
        "{seed}",
    ],
    "monitors": [
        *(".venv/bin/python", "-m", "tests.robustness.monitors"),
        *("--count", "1000000", "--seed", "{seed}"),
    ],
    "lives": [
        *(".venv/bin/python", "-m", "benchmarks.lives"),
        *("--lives", "200", "--seed", "{seed}"),
    ],
    "gestures": [
        *(".venv/bin/python", "-m", "benchmarks.gestures"),
        *("--count", "10000", "--seed", "{seed}"),
    ],
    "gesture-worlds": [
        *(".venv/bin/python", "-m", "tests.robustness.gestures"),
        *("--count", "40000", "--seed", "{seed}"),
    ],
    "soak": ["make", "soak", "ARGS=--duration 3600 --rate 1000"],
    "cortex-m33": [sys.executable, "-m", "tests.robustness.cortex_m33"],
    "test-compose": ["make", "test-compose"],
}
"""What runs, by the name of its log; ``{seed}`` is what ``--seed`` says, ``{source}`` Citus's
source tree."""
_ON_CITUS: Final = ("chaos-citus", "test-cluster")
"""Steps that need Citus."""


def main() -> int:
    """Run the steps and print what became of each."""
    parser = argparse.ArgumentParser(prog="make nightly", description=__doc__)
    parser.add_argument(
        "--step", action="append", choices=list(STEPS), help="only this; repeatable"
    )
    parser.add_argument("--seed", type=int, default=1, help="draws faults, cuts and inputs")
    options = parser.parse_args()
    logs = Path("build/nightly")
    logs.mkdir(parents=True, exist_ok=True)
    console = Console(stderr=True)
    table = Table("step", "result", "seconds", "log")
    failed, source = 0, os.environ.get(SOURCE, "")
    for name in options.step or STEPS:
        if name in _ON_CITUS and not (source or os.environ.get(PROGRAMS)):
            console.print(f"{name}: skipped: {NO_SOURCE}", highlight=False)
            table.add_row(name, "skipped", "", "")
            continue
        log, begun = logs / f"{name}.log", time.monotonic()
        command = [word.format(seed=options.seed, source=source) for word in STEPS[name]]
        with console.status(f"{name}: {' '.join(command)}"), log.open("wb") as out:
            status = subprocess.run(command, stdout=out, stderr=out, check=False).returncode
        failed += status != 0
        result = "passed" if status == 0 else f"FAILED ({status})"
        seconds = f"{time.monotonic() - begun:.0f}"
        console.print(f"{name}: {result} in {seconds} s", highlight=False)
        table.add_row(name, result, seconds, str(log))
    Console().print(table)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
