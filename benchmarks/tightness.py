"""How often bounds are the tightest: `python -m benchmarks.tightness --count 20000 --seed 1`."""

from __future__ import annotations

import argparse

import numpy as np

from tests.unit.eskin.kernels.tightness import CASES, UNSOUND


def main() -> None:
    """Print a table: of results of single numbers, which have one tightest interval."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20_000, help="results of each line")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print(f"{'operation':9} {'arguments':25} {'both tightest':>13} {'farthest':>8} {'unsound':>7}")
    for case in CASES:
        found = case.distances(options.count, options.seed)
        share = 100.0 * np.mean(np.all(found == 0, axis=1))
        unsound = int(np.sum(found == UNSOUND))
        print(f"{case.name:9} {case.arguments:25} {share:11.2f} % {found.max():8} {unsound:7}")


if __name__ == "__main__":
    main()
