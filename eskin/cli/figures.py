"""``eskin figures``: the paper's figures drawn anew."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eskin.errors import SettingsError

Out = Annotated[Path, typer.Option(help="Folder for the pictures (PNG) and their numbers (CSV).")]


def figures(out: Out) -> None:
    """Draw the paper's figures, each with a CSV of its numbers, and check what its text states."""
    from rich.console import Console
    from rich.progress import Progress

    from eskin.figures import write_figures

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("drawing", total=None)

        def show(name: str, done: int, total: int) -> None:
            bar.update(task, description=f"drawing {name}", completed=done, total=total)

        try:
            written = write_figures(out, progress=show)
        except OSError as error:
            raise SettingsError(
                "--out", f"{error.filename or out} cannot be written: {error.strerror}"
            ) from error
    typer.echo(f"{len(written)} files in {out}")
