"""``eskin demo`` runs the stack on one machine, ``eskin audit`` checks its claim."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eskin.command.logs import start_logs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from demo.audit import ChannelAudit

Data = Annotated[Path, typer.Option(help="Folder that keeps everything.")]
_DATA = Path("eskin-data")


def demo(
    data: Data = _DATA,
    nodes: Annotated[int, typer.Option(min=1, max=100, help="Sensor nodes to run.")] = 3,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the dashboard.")] = 8080,
    speed: Annotated[
        float | None,
        typer.Option(min=0.01, max=100, help="Emulated seconds per second; else each node's own."),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(min=0.1, help="Seconds to run; else until Ctrl-C.")
    ] = None,
) -> None:
    """Run the whole stack on this machine and print a URL that logs in."""
    from rich.console import Console

    from demo.service import run_demo

    start_logs("WARNING")
    run_demo(
        data, nodes=nodes, port=port, speed=speed, duration=duration, console=Console(stderr=True)
    )


def audit(data: Data = _DATA) -> None:
    """Check every stored interval against the truth that the emulator kept.

    Exit status 1 if one channel breaks its promise: a violation under bounded noise, or under
    Gaussian noise more of them than the 1 - 1e-6 quantile of its coverage.
    """
    from rich.console import Console
    from rich.progress import Progress

    from demo.audit import audit as compare
    from demo.layout import Layout

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("comparing blocks", total=None)
        found = compare(
            Layout(data.resolve()),
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    Console().print(_table(found))
    failed = [entry for entry in found if not entry.passes]
    samples = sum(entry.samples for entry in found)
    violations = sum(entry.violations for entry in found)
    typer.echo(
        f"{'FAILED' if failed else 'passed'}: {samples} samples, {violations} violations, "
        f"{len(found)} channels"
        + "".join(f"\n  broken promise: {entry.node}/{entry.channel}" for entry in failed)
    )
    if failed:
        raise typer.Exit(1)


def _table(found: Sequence[ChannelAudit]) -> Table:
    from rich.table import Table

    table = Table("node", "channel", title="What is stored, against what was true")
    for heading in (
        "blocks", "samples", "violations", "allowed", "wrong times", "unbounded",
        "truth dropped", "mean width", "relative",
    ):  # fmt: skip
        table.add_column(heading, justify="right")
    for e in found:
        table.add_row(
            e.node, e.channel, str(e.blocks), str(e.samples), str(e.violations), str(e.allowed),
            str(e.late), str(e.unbounded), str(e.forgotten), f"{e.mean_width:.3g} {e.unit}",
            f"{e.relative_width:.2%}", style=None if e.passes else "bold red",
        )  # fmt: skip
    return table
