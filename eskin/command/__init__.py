"""The ``eskin`` command: thin, one module a subcommand; only here are the tiers imported."""

from __future__ import annotations

import logging
import sys
from typing import NoReturn

import click
import typer

from eskin.command.cloud import cloud
from eskin.command.demo import audit, demo
from eskin.command.gateway import gateway
from eskin.command.node import node
from eskin.command.pki import pki
from eskin.errors import EskinError

__all__ = ["app", "main"]

app = typer.Typer(
    name="eskin",
    help="Smart skin sensors from the physics to the pixel, every value an interval.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command()(demo)
app.command()(audit)
app.command()(node)
app.command()(gateway)
app.add_typer(cloud, name="cloud")
app.add_typer(pki, name="pki")


def main() -> NoReturn:
    """Run the command; exit status 0, 1 where a check failed, or 2 with one clear line."""
    try:
        status = app(standalone_mode=False)
    except click.exceptions.Exit as stop:
        status = stop.exit_code
    except click.ClickException as error:
        error.show()
        status = 2
    except click.Abort:
        status = 130
    except EskinError as error:
        sys.stderr.write(f"eskin: {error}\n")
        status = 2
    logging.shutdown()
    sys.exit(status if isinstance(status, int) else 0)
