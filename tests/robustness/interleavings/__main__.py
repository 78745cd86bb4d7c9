"""Run clouds on one PostgreSQL store in every order of their statements, and check the laws.

Each pair and triple of operations is explored three times: all schedules but for the order of steps
that commute; all with few preemptions; and a sample with more. The table says how many were run,
and whether these are all. Exit status 1 if a schedule broke a law; `--replay` runs it again.
"""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

from rich.console import Console
from rich.table import Table

from tests.robustness.interleavings.checks import find_violations
from tests.robustness.interleavings.explorer import Replay, Sample, Search
from tests.robustness.interleavings.operations import OPERATIONS
from tests.robustness.interleavings.scenarios import PAIRS, TRIPLES, explore
from tests.robustness.interleavings.scheduler import Scheduler
from tests.robustness.interleavings.world import opened

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.robustness.interleavings.scenarios import Report, Strategy
    from tests.robustness.interleavings.scheduler import Execution
    from tests.robustness.interleavings.world import World

_FEW: Final = 3
"""Violations of a row of the table that are written."""
_FOLDER: Final = Path("build/interleavings")


def main() -> int:
    """Explore, or run one schedule again."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.robustness.interleavings", description=__doc__
    )
    parser.add_argument(
        "--pair", action="append", type=_operations, help="such as ingest,erase; repeatable"
    )
    parser.add_argument("--most", type=int, default=400, help="schedules of each exploration")
    parser.add_argument("--preemptions", type=int, default=2, help="most, where they are bounded")
    parser.add_argument("--sample", type=int, default=100, help="schedules of each sample")
    parser.add_argument("--seed", type=int, default=1, help="draws the samples")
    parser.add_argument("--replay", type=Path, help="run the schedule in a file again")
    options = parser.parse_args()
    logging.disable(logging.CRITICAL)  # conflicts, and refusals while a store is moved
    with TemporaryDirectory(prefix="eskin-interleavings-") as folder, opened(Path(folder)) as world:
        return _replay(world, options.replay) if options.replay else _explore(world, options)


def _operations(text: str) -> tuple[str, ...]:
    names = tuple(text.split(","))
    unknown = [name for name in names if name not in OPERATIONS]
    if unknown or not 2 <= len(names) <= 3:
        raise argparse.ArgumentTypeError(f"name two or three of {', '.join(OPERATIONS)}")
    return names


def _explore(world: World, options: argparse.Namespace) -> int:
    console, broken = Console(stderr=True), 0
    table = Table("operations", "schedules", "run", "of", "pruned", "steps", "waits", "broken", "s")
    for operations in options.pair or (*PAIRS, *TRIPLES):
        scheduler = Scheduler(world, operations)
        with scheduler.installed():
            for name, strategy, most in _strategies(options):
                title = f"{' ‖ '.join(operations)}, {name}"
                with console.status(title) as status:
                    report = explore(
                        world, scheduler, strategy, most=most,
                        progress=lambda r, t=title: status.update(f"{t}: {r.schedules}"),  # type: ignore[misc]  # bound now
                    )  # fmt: skip
                console.print(f"{title}: {report.schedules}", highlight=False)
                table.add_row(" ‖ ".join(operations), name, *_row(report))
                broken += len(report.violations)
                for execution, laws in report.violations[:_FEW]:
                    file = _write(operations, execution, laws)
                    console.print(f"BROKEN: {file}: {'; '.join(laws)}", markup=False)
    Console(width=120).print(table)
    return 1 if broken else 0


def _strategies(options: argparse.Namespace) -> list[tuple[str, Strategy, int]]:
    bound = options.preemptions
    return [
        ("all but for commuting steps", Search(None), options.most),
        (f"at most {bound} preemptions", Search(bound), options.most),
        ("drawn, at most 6 preemptions", Sample(options.seed, 6), options.sample),
    ]


def _row(report: Report) -> list[str]:
    return [
        str(report.schedules),
        "all" if report.complete else "more",
        str(report.pruned),
        str(report.steps),
        str(report.blocked),
        "0" if report.first is None else f"{len(report.violations)}, first {report.first}",
        f"{report.seconds:.0f}",
    ]


def _write(operations: Sequence[str], execution: Execution, laws: Sequence[str]) -> Path:
    _FOLDER.mkdir(parents=True, exist_ok=True)
    number = sum(1 for _ in _FOLDER.glob("*.txt")) + 1
    file = _FOLDER / f"{'-'.join(operations)}-{number}.txt"
    lines = [f"# {','.join(operations)}", *(f"# {law}" for law in laws), *execution.lines()]
    file.write_text("\n".join(lines) + "\n")
    return file


def _replay(world: World, file: Path) -> int:
    first, *lines = file.read_text().splitlines()
    order = [line.partition(":")[0] for line in lines if not line.startswith("#")]
    scheduler = Scheduler(world, _operations(first.removeprefix("# ")))
    with scheduler.installed():
        execution = scheduler.run(Replay(order))
    laws = find_violations(world, execution)
    for line in [*execution.lines(), *(f"BROKEN: {law}" for law in laws)]:
        Console().print(line, markup=False, highlight=False, soft_wrap=True)
    return 1 if laws else 0


if __name__ == "__main__":
    sys.exit(main())
