"""Random boxes for every model, against its formula in many bits.

Parameters are zero, subnormal, huge, negative where allowed, thin and wide. A result counts as a
violation where the formula's value at a member of the box certainly lies outside of it, or where it
is no interval at all (NaN, or empty). Exit status 1 if there is one.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import track
from rich.table import Table

from tests.robustness.boxes.cases import CASES
from tests.robustness.boxes.verify import verify

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.robustness.boxes.verify import Outcome


def main() -> int:
    """Verify the models and print a table."""
    parser = argparse.ArgumentParser(prog="python -m tests.robustness.boxes", description=__doc__)
    parser.add_argument("--count", type=int, default=2000, help="boxes of each model")
    parser.add_argument("--seed", type=int, default=1, help="draws the boxes")
    parser.add_argument("--jobs", type=int, default=2, help="models at once")
    parser.add_argument(
        "--model", action="append", choices=list(CASES), help="only this; repeatable"
    )
    options = parser.parse_args()
    names = options.model or list(CASES)
    counts, seeds = [options.count] * len(names), [options.seed] * len(names)
    progress = Console(stderr=True)
    with ProcessPoolExecutor(options.jobs) as pool:
        found = pool.map(verify, names, counts, seeds)
        outcomes = list(track(found, "models", total=len(names), console=progress))
    _report(outcomes, options.seed)
    return 1 if any(outcome.violations for outcome in outcomes) else 0


def _report(outcomes: Sequence[Outcome], seed: int) -> None:
    console = Console()
    table = Table(title=f"random boxes, seed {seed}")
    for heading in ("model", "boxes", "members", "violations", "worst excess"):
        table.add_column(heading, justify="left" if heading == "model" else "right")
    for outcome in outcomes:
        numbers = outcome.boxes, outcome.points, outcome.violations
        excess = f"{outcome.excess:.3g}" if outcome.violations else "0"
        table.add_row(outcome.name, *(f"{number:,}" for number in numbers), excess)
    boxes, members = sum(o.boxes for o in outcomes), sum(o.points for o in outcomes)
    wrong = sum(o.violations for o in outcomes)
    table.add_row("all", f"{boxes:,}", f"{members:,}", f"{wrong:,}", "", style="bold")
    console.print(table)
    for outcome in outcomes:
        for example in outcome.examples:
            console.print(f"{outcome.name}: {example}", markup=False, highlight=False)


if __name__ == "__main__":
    sys.exit(main())
