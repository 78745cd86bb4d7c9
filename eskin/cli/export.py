"""``eskin export``: a labelled dataset of a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eskin.errors import SettingsError

Scenario = Annotated[
    str, typer.Option(help="Scenario file (TOML), or a packaged one such as hand.toml.")
]
Out = Annotated[Path, typer.Option(help="Folder for the dataset; made if missing.")]
Runs = Annotated[int, typer.Option(min=2, max=100_000, help="Runs, each with a seed of its own.")]
TestRuns = Annotated[int, typer.Option(min=1, help="How many of them are for testing.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the first run; the others follow.")]
Rate = Annotated[float, typer.Option(min=1e-3, max=1e6, help="Samples in a second.")]
Licence = Annotated[str, typer.Option(help="Licence that the data card names.")]


def export(
    scenario: Scenario,
    out: Out,
    runs: Runs = 10,
    test_runs: TestRuns = 2,
    seed: Seed = 0,
    rate: Rate = 100.0,
    licence: Licence = "CC0-1.0",
) -> None:
    """Write a labelled dataset of a scenario: Parquet and CSV, the truth beside the intervals."""
    from eskin_sensor_node.tools.dataset import Plan, write_dataset
    from rich.console import Console
    from rich.progress import Progress

    if test_runs >= runs:
        raise SettingsError("--test-runs", f"{test_runs} must be less than --runs {runs}")
    if round(1e9 / rate) * rate != 1e9:
        raise SettingsError(
            "--rate", f"{rate!r} is not allowed: its period must be whole nanoseconds"
        )
    plan = Plan.of(scenario, seeds=range(seed, seed + runs), test=test_runs, rate=rate)
    if len(plan.seconds) == 0:
        raise SettingsError("--rate", f"{rate!r} takes no sample in {plan.script.duration_s:g} s")
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("exporting", total=None)

        def show(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        try:
            files = write_dataset(plan, out, licence=licence, progress=show)
        except OSError as error:
            raise SettingsError(
                "--out", f"{error.filename or out} cannot be written: {error.strerror or error}"
            ) from error
    typer.echo(f"{len(files)} files in {out}")
