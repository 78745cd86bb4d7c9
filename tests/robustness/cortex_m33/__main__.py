"""``python -m tests.robustness.cortex_m33``: count anew, and compare with the committed table."""

from __future__ import annotations

import argparse
import sys

from tests.robustness.cortex_m33.machine import ROOT, MachineError, install
from tests.robustness.cortex_m33.table import PATH, TOLERANCE, Table, count


def main() -> int:
    """Exit status: 0 where the table holds."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.robustness.cortex_m33", description=__doc__
    )
    parser.add_argument("--write", action="store_true", help="write the table instead")
    write = parser.parse_args().write
    install()
    try:
        found = count()
    except MachineError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    if write:
        found.write()
        return 0
    differences = found.differences(Table.read())
    for each in differences:
        sys.stderr.write(f"{PATH.relative_to(ROOT)}: {each}\n")
    said = f"{len(found.prices)} prices, equal bits, {len(differences)} beyond {TOLERANCE:.0%}"
    sys.stdout.write(said + "\n")
    return 1 if differences else 0


if __name__ == "__main__":
    sys.exit(main())
