"""The ``eskin`` command: thin, one module a subcommand; only here are the tiers imported."""

from __future__ import annotations

import logging
import os
import sys
from importlib.metadata import version as installed
from typing import TYPE_CHECKING, Annotated, Final, NoReturn

import typer

from eskin.cli.backup import backup
from eskin.cli.cloud import cloud
from eskin.cli.demo import audit, demo
from eskin.cli.energy import energy
from eskin.cli.export import export
from eskin.cli.figures import figures
from eskin.cli.gateway import gateway
from eskin.cli.node import node
from eskin.cli.pki import pki
from eskin.cli.subjects import subjects
from eskin.cli.warm import warm
from eskin.errors import EskinError, unprefixed
from eskin.runtime.printable import printable_lines

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["app", "main"]

_EXTRAS: Final = {"matplotlib": "figures", "pkcs11": "pkcs11"}
"""Libraries that come with an extra of their own; all others that a command needs are the stack."""

app = typer.Typer(name="eskin", add_completion=False, pretty_exceptions_enable=False)
"""The command, for callers from Python."""
app.command()(demo)
app.command()(audit)
app.command()(figures)
app.command()(export)
app.command()(energy)
app.command()(warm)
app.command()(backup)
app.command()(node)
app.command()(gateway)
app.add_typer(cloud, name="cloud")
app.add_typer(pki, name="pki")
app.add_typer(subjects, name="subjects")


@app.callback(invoke_without_command=True)
def overview(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
) -> None:
    """Smart skin sensors from the physics to the pixel, every value an interval."""
    if version:
        typer.echo(f"eskin {installed('eskin')}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def main() -> NoReturn:
    """Run the command; exit status 0, 1 where a check failed, or 2 with one clear line."""
    os.umask(0o077)  # spool, store, flash and keys are their owner's business
    try:
        status = app(prog_name="eskin", standalone_mode=False)
    except typer.Exit as stop:
        status = stop.exit_code
    except typer.Abort:
        status = 130
    except (typer.TyperException, EskinError) as error:
        sys.stderr.write(f"eskin: {printable_lines(_said(error))}\n")
        status = 2
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0].startswith("eskin"):
            raise
        extra = _EXTRAS.get(error.name.partition(".")[0], "stack")
        sys.stderr.write(f"eskin: {error.name} is not installed; install eskin[{extra}]\n")
        status = 2
    logging.shutdown()
    sys.exit(status if isinstance(status, int) else 0)


def _said(error: Exception) -> str:
    """One line; bad usage also says which value it was, and where help is."""
    if isinstance(error, EskinError):
        return str(error)
    shown = unprefixed(getattr(error, "format_message", error.__str__)()).rstrip(".")
    shown = shown.replace("\n\t", " ")  # between the choices of an option that is missing
    given = _given(getattr(getattr(error, "param", None), "opts", []))
    if given is not None and repr(given) not in shown:
        shown += f", not {given!r}"
    stop = "" if shown.endswith("?") else "."
    return f"{shown}{stop} See `eskin --help`, or --help after a command."


def _given(options: Sequence[str]) -> str | None:
    """What was written after an option; typer's message often leaves it out."""
    for option in options:
        for word, after in zip(sys.argv, [*sys.argv[1:], ""], strict=True):
            if word == option:
                return after
            if word.startswith(f"{option}="):
                return word.removeprefix(f"{option}=")
    return None
