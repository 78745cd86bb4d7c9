"""``make model``: TLC over the model of delivery.

Exit status 1 if an invariant or a property is violated, or a mutant is not.
"""

from __future__ import annotations

import argparse
import sys
import time

from rich.console import Console
from rich.table import Table

from tests.robustness.model.bounds import LARGE, SMALL, Bounds
from tests.robustness.model.mutants import MUTANTS
from tests.robustness.model.tlc import MODULES, TlcError, check


def main() -> int:
    """Check the model, or its mutants."""
    parser = argparse.ArgumentParser(prog="make model", description=__doc__)
    parser.add_argument("--large", action="store_true", help="larger bounds: an hour or more")
    parser.add_argument("--mutants", action="store_true", help="break each guard instead")
    parser.add_argument("--only", action="append", help="these bounds or mutants; repeatable")
    parser.add_argument("--seconds", type=float, default=300.0, help="most time of a run")
    options = parser.parse_args()
    source = (MODULES / "Delivery.tla").read_text()
    bounds = LARGE if options.large else SMALL
    runs: dict[str, tuple[str, Bounds, str | None]] = {
        name: (source, each, None) for name, each in bounds.items()
    }
    if options.mutants:
        runs = {m.name: (m.apply(source), SMALL[m.bounds], m.broken) for m in MUTANTS}
    table = Table("run", "result", "expected", "length", "states", "distinct", "seconds")
    wrong = 0
    for name, (text, each, expected) in runs.items():
        if options.only and name not in options.only:
            continue
        begun = time.monotonic()
        try:
            found = check(
                {"Delivery": text}, "Delivery", each.configuration(), seconds=options.seconds
            )
        except TlcError as error:
            Console(stderr=True).print(str(error), markup=False)
            wrong += 1
            table.add_row(name, "not checked", expected or "passed")
            continue
        right = found.broken == expected
        wrong += not right
        if not right and expected is None:
            Console(stderr=True).print(found.output[-8000:], markup=False)
        Console(stderr=True).print(f"{name}: {found.broken or 'passed'}", markup=False)
        table.add_row(
            *(name, found.broken or "passed", expected or "passed", str(found.length)),
            *(f"{found.generated:,}", f"{found.distinct:,}", f"{time.monotonic() - begun:.0f}"),
        )
    Console().print(table)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
