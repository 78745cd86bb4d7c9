"""``python -m tests.boxes``: hostile boxes of every model against high precision.

Frequencies, times and phases are 0, subnormal, huge and intervals. Exit status 1 if a member of a
box lies outside of its enclosure.
"""

from __future__ import annotations

import argparse
import sys

from rich.console import Console
from rich.progress import track
from rich.table import Table

from tests.boxes.models import EVERY
from tests.boxes.verify import verify


def main() -> int:
    """Verify the models and print a table."""
    parser = argparse.ArgumentParser(prog="python -m tests.boxes", description=__doc__)
    parser.add_argument("--count", type=int, default=2000, help="boxes of each model")
    parser.add_argument("--seed", type=int, default=1, help="draws the boxes")
    parser.add_argument(
        "--model", action="append", choices=list(EVERY), help="only this; repeatable"
    )
    options = parser.parse_args()
    console = Console(stderr=True)
    table = Table("model", "boxes", "refused", "points", "violations", "worst, relative")
    failed = 0
    for name in track(options.model or list(EVERY), "models", console=console):
        found = verify(name, count=options.count, seed=options.seed)
        for text in found.violations[:3]:
            console.print(f"{name}: {text}", markup=False, highlight=False)
        failed += len(found.violations)
        numbers = (found.boxes, found.refused, found.points, len(found.violations))
        table.add_row(name, *(f"{number}" for number in numbers), f"{found.worst:.3g}")
    Console().print(table)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
