"""``make fuzz``: hostile inputs to every way in, until there are so many of each.

An input that breaks its target's oracle, or takes longer than 30 s, is kept in the folder, and
printed with the command that tries it again. Exit status 1 if there is one, or if memory grew.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn
from rich.table import Table

from tests.robustness.fuzz.session import Finding, Session
from tests.robustness.fuzz.target import NAMES, load

_MILLION: Final = 1_000_000


def main() -> int:
    """Fuzz the targets, two at a time, and print a table; or try one input again."""
    parser = argparse.ArgumentParser(prog="make fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=_MILLION, help="of each target")
    parser.add_argument(
        "--target", action="append", choices=NAMES, help="only this; may be repeated"
    )
    parser.add_argument("--seed", type=int, default=1, help="draws the inputs")
    parser.add_argument("--jobs", type=int, default=2, help="targets at once")
    parser.add_argument("--folder", type=Path, default=Path("build/fuzz"), help="takes findings")
    parser.add_argument("--replay", type=Path, help="try this input on the target, nothing else")
    options = parser.parse_args()
    names = options.target or list(NAMES)
    if options.replay is not None:
        return _replay(names, options.replay)
    sessions = [
        Session(name, inputs=options.inputs, seed=options.seed, folder=options.folder / name)
        for name in names
    ]
    console = Console(stderr=True)
    findings = _run(sessions, jobs=options.jobs, console=console)
    Console().print(_table(findings))
    for finding in findings:
        for path in finding.broken:
            words = ["--target", finding.target, "--replay", str(path)]
            console.print(f"again: make fuzz ARGS={shlex.quote(shlex.join(words))}")
        if finding.broken or finding.fault:
            console.print(f"{finding.target}: {finding.fault or finding.said}", markup=False)
    return 1 if any(finding.broken or finding.fault for finding in findings) else 0


def _run(sessions: list[Session], *, jobs: int, console: Console) -> list[Finding]:
    columns = ("{task.description:>14}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as bars, ThreadPoolExecutor(jobs) as pool:

        def run(session: Session) -> Finding:
            bar = bars.add_task(session.target, total=session.inputs)
            return session.run(tell=lambda inputs: bars.update(bar, completed=inputs))

        return list(pool.map(run, sessions))


def _table(findings: list[Finding]) -> Table:
    table = Table("target", title="make fuzz")
    for name in ("inputs", "inputs/s", "paths", "kept", "broken", "slowest ms", "growth MiB"):
        table.add_column(name, justify="right")
    for found in findings:
        table.add_row(
            found.target,
            f"{found.inputs}",
            f"{found.rate:.0f}",
            f"{found.paths}",
            f"{found.kept}",
            f"{len(found.broken)}",
            f"{found.slowest_s * 1e3:.1f}",
            f"{found.growth_mib:.1f}",
        )
    return table


def _replay(names: list[str], path: Path) -> int:
    (name,) = names
    with tempfile.TemporaryDirectory() as scratch:
        load(name, Path(scratch)).check(path.read_bytes())
    sys.stdout.write(f"{path}: {name} holds\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
