"""``eskin node``: one emulated sensor node."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eskin.command.logs import start_logs


def node(
    config: Annotated[
        Path, typer.Option(envvar="ESKIN_CONFIG", help="TOML file with the node's settings.")
    ],
) -> None:
    """Run one emulated sensor node."""
    from authority.keeper import Keeper
    from sensor_node.service import run
    from sensor_node.settings import NodeSettings

    settings = NodeSettings.load(config)
    start_logs(settings.log.level)
    own = settings.identity
    with Keeper(settings.renewal, [own.directory], site=own.site):
        run(settings)
