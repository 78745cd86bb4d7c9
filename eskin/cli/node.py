"""``eskin node``: emulated sensor nodes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eskin.runtime.logs import start_logs


def node(
    config: Annotated[
        Path, typer.Option(envvar="ESKIN_CONFIG", help="TOML file with the node's settings.")
    ],
    count: Annotated[
        int | None,
        typer.Option(
            min=0, help="Run a fleet of so many nodes; instead of the file's fleet.count."
        ),
    ] = None,
) -> None:
    """Run one emulated sensor node, or a fleet of them.

    A fleet is many nodes of one design in one process, called NAME-0001 and so on after node.name:
    each with its own identity (a folder of its name under identity.directory), connection, outbox,
    noise and settings. `eskin pki issue --count` or `eskin pki enrol --count` makes identities. It
    ends on SIGTERM or Ctrl-C; what was not acknowledged waits for the next start.
    """
    from eskin_ca.renewal_agent import RenewalAgent
    from eskin_sensor_node.fleet import run_fleet
    from eskin_sensor_node.service import run
    from eskin_sensor_node.settings import FleetSection, NodeSettings

    from eskin.identity import numbered

    settings = NodeSettings.load(config)
    if count is not None:
        settings = settings.model_copy(update={"fleet": FleetSection(count=count)})
    start_logs(settings.log.level)
    own = settings.identity
    names = numbered(settings.node.name, settings.fleet.count)
    identities = [own.directory / name for name in names] or [own.directory]
    with RenewalAgent(settings.renewal, identities, site=own.site):
        if names:
            run_fleet(settings)
        else:
            run(settings)
