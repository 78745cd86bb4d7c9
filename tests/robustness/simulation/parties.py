"""What all runs of a process share: identities, and an empty store."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_cloud.store import Store

from eskin.identity import ChainVerifier, IdentityKind, client_context
from eskin.identity.identity import ROOT_FILE
from eskin.wire.envelope import Opener
from tests.robustness.simulation.faults import GATEWAYS, NODES
from tests.support.identities import Identities

if TYPE_CHECKING:
    from pathlib import Path


class Parties:
    """Identities of nodes, site, gateways and cloud. Their keys are in no history.

    Args:
        folder: Where they are written.
    """

    def __init__(self, folder: Path) -> None:
        made = Identities(folder / "identities")
        self.site = made.site
        self.site_file = made.site.directory / "chain.pem"
        self.nodes = {name: made.make(IdentityKind.NODE, name) for name in NODES}
        self.gateways = {
            name: made.make(IdentityKind.GATEWAY, f"gateway.{name}") for name in GATEWAYS
        }
        self.cloud = made.make(IdentityKind.SERVER, "server.cloud")
        self.contexts = {
            name: client_context(each.directory / ROOT_FILE, each)
            for name, each in self.gateways.items()
        }
        self.verifier = ChainVerifier(*made.gateway.roots)
        self.openers = {
            name: Opener([each], sender=lambda _: made.site.certificate)
            for name, each in self.nodes.items()
        }
        self.empty_store = folder / "empty.sqlite"
        Store(self.empty_store, threaded=False).close()
