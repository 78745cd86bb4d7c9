"""Random truths of small skins, and gestures of the intervals around them, against an oracle.

A world counts as wrong where a certain answer does not hold with all its bounds, or where a gesture
of the truth is missing. Exit status 1 if there is one.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from typing import Final

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from eskin.gestures.templates import PAIR_KINDS, TOUCH_KINDS
from tests.unit.eskin.gestures.worlds import check, draw_world

_SHOWN: Final = 20


def main() -> int:
    """Compare and print a table."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.robustness.gestures", description=__doc__
    )
    parser.add_argument("--count", type=int, default=1000, help="worlds")
    parser.add_argument("--seed", type=int, default=1, help="draws the worlds")
    options = parser.parse_args()
    counts: Counter[str] = Counter()
    wrong = []
    for number in track(range(options.count), "worlds", console=Console(stderr=True)):
        world = draw_world(np.random.default_rng((options.seed, number)))
        try:
            counts += check(world, world.found())
        except AssertionError as error:
            wrong.append(f"world {options.seed}, {number}: {error}")
    console = Console()
    table = Table("gesture", "true", "certain", "possible", title=f"{options.count} worlds")
    for kind in (*TOUCH_KINDS, *PAIR_KINDS):
        names = f"true {kind}", f"{kind} certain", f"{kind} possible"
        table.add_row(kind, *(f"{counts[name]:,}" for name in names))
    console.print(table)
    for line in wrong[:_SHOWN]:
        console.print(line, markup=False, highlight=False)
    console.print(f"{len(wrong)} worlds are wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
