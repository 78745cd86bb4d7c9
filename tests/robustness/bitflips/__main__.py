"""``tests.robustness.bitflips``: flip bits of each part's files, and read them by the real code.

After a flip the part names what is damaged, or the bit was of no use and nothing changes. Exit
status 1 if one did neither.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter, defaultdict

from rich.console import Console
from rich.progress import track
from rich.table import Table

from tests.robustness.bitflips.part import NAMES
from tests.robustness.bitflips.verdict import Outcome, attack

_FEW = 3


def main() -> int:
    """Flip, judge, tell."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.robustness.bitflips", description=__doc__
    )
    parser.add_argument("--flips", type=int, default=500, help="of each part")
    parser.add_argument("--seed", type=int, default=1, help="draws the bits")
    parser.add_argument("--part", action="append", choices=NAMES, help="only this; repeatable")
    parser.add_argument("--table", action="append", help="only this of a database; repeatable")
    options = parser.parse_args()
    tables = options.table or ()
    console = Console(stderr=True)
    found: dict[tuple[str, str], Counter[Outcome]] = defaultdict(Counter)
    for name in options.part or NAMES:
        verdicts = attack(name, flips=options.flips, seed=options.seed, tables=tables)
        for verdict in track(verdicts, name, total=options.flips, console=console):
            counted = found[name, str(verdict.flip.place)]
            counted[verdict.outcome] += 1
            if verdict.outcome is Outcome.BROKEN and counted[verdict.outcome] <= _FEW:
                console.print(f"BROKEN: {name}: {verdict.flip}: {verdict.why}", markup=False)
    table = Table("part", "place", *("flips", *Outcome), title="bit flips")
    for (name, place), counted in sorted(found.items()):
        numbers = [counted.total(), *(counted[each] for each in Outcome)]
        table.add_row(name, place, *map(str, numbers))
    Console(width=110).print(table)
    return 1 if any(counted[Outcome.BROKEN] for counted in found.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
