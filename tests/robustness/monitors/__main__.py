"""Random formulas over random signals, against their meaning in fractions.

Draws formulas with nested windows of past and future, channels in two units, gaps, uncertain
instants and no samples at all. A scene counts as wrong where a verdict is not that of the
definition, or where a formula that is called exact leaves open what no world decides either way.
Exit status 1 if there is one.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from rich.console import Console
from rich.progress import track
from rich.table import Table

from eskin.interval import Verdict
from tests.unit.eskin.monitor.oracle.judge import Outcome, judge

_BATCH = 500
_SHOWN = 20


def main() -> int:
    """Compare and print a table."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.robustness.monitors", description=__doc__
    )
    parser.add_argument("--count", type=int, default=10_000, help="scenes")
    parser.add_argument("--seed", type=int, default=1, help="draws the scenes")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    options = parser.parse_args()
    batches = [
        range(first, min(first + _BATCH, options.count))
        for first in range(0, options.count, _BATCH)
    ]
    total = Outcome()
    with ProcessPoolExecutor(options.jobs) as pool:
        found = pool.map(partial(judge, label=f"seed {options.seed}"), batches)
        for outcome in track(found, "scenes", total=len(batches), console=Console(stderr=True)):
            total.add(outcome)
    console = Console()
    table = Table(title=f"random formulas, seed {options.seed}")
    columns = {
        "scenes": total.scenes,
        "called exact": total.exact,
        **{verdict.name.lower(): total.verdicts[verdict] for verdict in Verdict},
        "wrong": len(total.wrong),
    }
    for name in columns:
        table.add_column(name, justify="right")
    table.add_row(*(f"{number:,}" for number in columns.values()))
    console.print(table)
    for line in total.wrong[:_SHOWN]:
        console.print(line, markup=False, highlight=False)
    return 1 if total.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
