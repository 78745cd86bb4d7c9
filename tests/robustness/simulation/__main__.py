"""``make simulate``: nodes, gateways and a cloud in one thread, under seeded faults.

Exit status 1 if a law of delivery is broken: then the fewest faults that break it are printed.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from tests.robustness.simulation.faults import plan
from tests.robustness.simulation.parties import Parties
from tests.robustness.simulation.shrink import shrink
from tests.robustness.simulation.world import Run, simulate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.robustness.simulation.faults import Fault


def main() -> int:
    """Run seeds, or replay one; shrink the first that breaks a law."""
    parser = argparse.ArgumentParser(prog="make simulate", description=__doc__)
    parser.add_argument("--seed", type=int, help="run this seed only, and print its history")
    parser.add_argument("--seeds", type=int, default=100, help="how many seeds, from 1 on")
    parser.add_argument("--first", type=int, default=1, help="the first of them")
    parser.add_argument("--count", type=int, default=8, help="faults of each seed")
    parser.add_argument("--faults", help="only these of the seed, as in 3,7; none if empty")
    options = parser.parse_args()
    with Parties() as parties:
        if options.seed is not None:
            faults = plan(options.seed, options.count)
            if options.faults is not None:
                wanted = {int(each) for each in options.faults.split(",") if each}
                faults = [each for each in faults if each.number in wanted]
            return _replay(options.seed, options.count, faults, parties)
        seeds = range(options.first, options.first + options.seeds)
        return _run_all(seeds, options.count, parties)


def _replay(seed: int, count: int, faults: Sequence[Fault], parties: Parties) -> int:
    """Run one seed and print all that happened."""
    run = simulate(seed, faults, parties)
    print("\n".join(run.history))  # noqa: T201 - the history is the output
    if run.broken is None:
        return 0
    _report(run, count, parties)
    return 1


def _run_all(seeds: range, count: int, parties: Parties) -> int:
    console = Console(stderr=True)
    runs: list[Run] = []
    begun = time.monotonic()
    with console.status("starting") as status:
        for seed in seeds:
            runs.append(simulate(seed, plan(seed, count), parties))
            runs[-1].history.clear()  # those of thousands of seeds take more than a gigabyte
            status.update(f"seed {seed} of {seeds[-1]}: {runs[-1].messages} messages")
            if runs[-1].broken is not None:
                break
    _print_table(runs, time.monotonic() - begun)
    if runs[-1].broken is None:
        return 0
    _report(runs[-1], count, parties)
    return 1


def _report(run: Run, count: int, parties: Parties) -> None:
    """Print what is broken, and the fewest faults that break it."""
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"seed {run.seed}, {len(run.faults)} faults: {run.broken}", markup=False)
    few = shrink(run.faults, lambda some: simulate(run.seed, some, parties).broken is not None)
    last = simulate(run.seed, few, parties)
    console.print(f"with {len(few)} of them: {last.broken}", markup=False)
    for fault in few:
        console.print(f"  {fault}", markup=False)
    numbers = ",".join(str(fault.number) for fault in few)
    console.print(
        f"again: make simulate ARGS=\"--seed {run.seed} --count {count} --faults '{numbers}'\"",
        markup=False,
    )


def _print_table(runs: Sequence[Run], seconds: float) -> None:
    faults = Counter((_role(each), each.kind) for run in runs for each in run.faults)
    table = Table("part", "fault", "count")
    for (part, kind), number in sorted(faults.items()):
        table.add_row(part, kind, str(number))
    console = Console()
    console.print(table)
    console.print(
        f"seeds {len(runs)}, faults {faults.total()}, steps {sum(run.steps for run in runs)}, "
        f"messages {sum(run.messages for run in runs)}, "
        f"simulated {sum(run.simulated_s for run in runs):.0f} s in {seconds:.0f} s",
        highlight=False,
        soft_wrap=True,
    )


def _role(fault: Fault) -> str:
    return {"p": "node", "s": "node", "g": "gateway", "c": "cloud"}[fault.part[0]]


if __name__ == "__main__":
    sys.exit(main())
