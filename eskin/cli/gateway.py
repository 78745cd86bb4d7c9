"""``eskin gateway``: from the broker to the cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eskin.identity import IdentityKind
from eskin.runtime.logs import start_logs


def gateway(
    config: Annotated[
        Path, typer.Option(envvar="ESKIN_CONFIG", help="TOML file with the gateway's settings.")
    ],
) -> None:
    """Run a gateway: authenticate, spool, forward, acknowledge, republish."""
    from eskin_ca.renewal_agent import RenewalAgent
    from eskin_gateway.service import run
    from eskin_gateway.settings import GatewaySettings

    settings = GatewaySettings.load(config)
    start_logs(settings.log.level)
    own = settings.identity
    lists = {IdentityKind.NODE: own.revocations}
    with RenewalAgent(settings.renewal, [own.directory, own.site], lists=lists):
        run(settings)
