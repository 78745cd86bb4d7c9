"""``eskin demo`` runs the stack on one machine, ``eskin audit`` checks its claim."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections import Counter
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eskin.cli.tables import add_row, show
from eskin.runtime.logs import start_logs
from eskin.runtime.printable import printable

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.table import Table

    from eskin.demo.audit import Audit, ChannelAudit

Data = Annotated[Path, typer.Option(file_okay=False, help="Folder that keeps everything.")]
_DATA = Path("eskin-data")


def demo(
    data: Data = _DATA,
    nodes: Annotated[
        int | None,
        typer.Option(min=1, max=100, help="Sensor nodes to run; else 4, or 1 with --skin."),
    ] = None,
    skin: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Large skin that each node has, such as paper-hand."),
    ] = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the dashboard.")] = 8080,
    speed: Annotated[
        float | None,
        typer.Option(min=0.01, max=100, help="Emulated seconds per second; else each node's own."),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(min=0.1, help="Seconds to run; else until Ctrl-C.")
    ] = None,
    certificate_days: Annotated[
        float, typer.Option(min=0.0001, max=398, help="Days of validity of certificates.")
    ] = 90.0,
    embedded_broker: Annotated[
        bool,
        typer.Option("--embedded-broker", help="Use no Mosquitto, also where it is installed."),
    ] = False,
) -> None:
    """Run the whole stack on this machine and print a URL that logs in."""
    from rich.console import Console

    from eskin.demo.service import Options, run_demo

    start_logs("WARNING")
    run_demo(
        data,
        Options(
            nodes=nodes,
            skin=skin,
            port=port,
            speed=speed,
            duration=duration,
            lifetime=timedelta(days=certificate_days),
            embedded_broker=embedded_broker,
        ),
        command=_command(),
        console=Console(stderr=True),
    )


def audit(data: Data = _DATA) -> None:
    """Check every stored interval against the truth that the emulator kept.

    It sums up the channels of each patch, and opens what is sealed. Exit status 1 if one patch
    breaks its promise (a violation under bounded noise, or under Gaussian noise more of them than
    the 1 - 1e-6 quantile of its coverage), or if a frame that a node made is neither stored, nor
    under way, nor reported as lost, or is stored twice.
    """
    from rich.console import Console
    from rich.progress import Progress

    from eskin.demo.audit import audit as compare
    from eskin.demo.layout import DemoFolder

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("comparing samples", total=None)
        found = compare(
            DemoFolder(data.resolve()),
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    show(_table(found.channels))
    for line in _remarks(found):
        typer.echo(printable(line))
    samples = sum(entry.samples for entry in found.channels)
    violations = sum(entry.violations for entry in found.channels)
    typer.echo(
        f"{'passed' if found.passes else 'FAILED'}: {samples} samples, {violations} violations, "
        f"{len(found.channels)} patches"
    )
    for entry in found.channels:
        if not entry.passes:
            typer.echo(printable(f"  broken promise: {entry.node}/{entry.channel}"))
    for delivery in found.deliveries:
        if not delivery.passes:
            first = delivery.missing[0]
            vanished = (
                f"  vanished: {len(delivery.missing)} frames of {delivery.node}, the first at "
                f"boot {first.boot}, sequence {first.sequence}"
            )
            typer.echo(printable(vanished))
    for node, doubled in found.doubled.items():
        if doubled:
            typer.echo(printable(f"  stored twice: {len(doubled)} frames of {node}"))
    if not found.passes:
        raise typer.Exit(1)


def _remarks(found: Audit) -> Iterator[str]:
    for entry in found.channels:
        if _also(entry):
            yield f"{entry.node}/{entry.channel}: {_also(entry)}"
    for delivery in found.deliveries:
        yield (
            f"{delivery.node}: of {delivery.made} frames {delivery.stored} are stored, "
            f"{delivery.waiting} under way, {delivery.lost} reported as lost, "
            f"{delivery.unborn} not yet in flash, {delivery.removed} removed as reported"
        )
    claims = Counter(entry.coverage for entry in found.channels)
    for coverage, count in sorted(claims.items()):
        claim = "1" if coverage == 1.0 else f"1 - {1.0 - coverage:.2g}"
        yield f"claimed coverage of a sample: {claim} (patches: {count})"
    for row in found.damaged:
        yield f"damaged in the store, and not compared: {row}; bring it back from a backup"
    for node, departures in sorted(found.departures.items()):
        for each in departures:
            yield (
                f"{node}: beyond its data sheet: {each}; its distances, areas and pressures may "
                "violate, which counts"
            )
    for letter, count in Counter(found.letters).items():
        yield f"refused by the gateway: {count} of {letter}"


def _command() -> str:
    """How the user called ``eskin``, to be typed again."""
    called = sys.argv[0]
    if Path(called).name == "__main__.py":
        return shlex.join([sys.executable, "-m", "eskin"])
    found = shutil.which("eskin")
    same = found is not None and Path(found).resolve() == Path(called).resolve()
    return "eskin" if same else shlex.quote(called)


def _table(found: Sequence[ChannelAudit]) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    title = "What is stored, against what was true"
    table = Table(title=title, box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("patch", no_wrap=True)
    for heading in ("samples", "violations", "allowed", "mean width"):
        table.add_column(heading, justify="right", no_wrap=True)
    for entry in found:
        add_row(
            table,
            f"{entry.node}/{entry.channel}",
            str(entry.samples),
            str(entry.violations),
            str(entry.allowed),
            f"{entry.mean_width:.2e} {entry.unit} {_share(entry.relative_width)}",
            style=None if entry.passes else "bold red",
        )
    return table


def _share(relative: float) -> str:
    """A width relative to the truth; none where the truth is zero, or almost."""
    return f"{relative:6.2%}" if relative < 10.0 else f"{'-':>6}"


def _also(entry: ChannelAudit) -> str:
    """What is worth a word, where there is any."""
    words = {
        "frames with a wrong time": entry.late,
        "frames under a wrong label": entry.mislabelled,
        "samples unbounded": entry.unbounded,
        "frames whose truth was dropped": entry.forgotten,
    }
    return ", ".join(f"{count} {what}" for what, count in words.items() if count)
