"""What all runs of a process share: identities, a folder in memory, and engines of the store."""

from __future__ import annotations

import tempfile
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Self
from unittest.mock import patch

from eskin_cloud.store import Store
from eskin_cloud.store.location import reading_engine, writing_engine

from eskin.identity import ChainVerifier, IdentityKind, client_context
from eskin.identity.identity import ROOT_FILE
from eskin.wire.envelope import Opener
from tests.robustness.simulation.faults import GATEWAYS, NODES
from tests.support.identities import Identities

if TYPE_CHECKING:
    from types import TracebackType


class Parties:
    """Identities of nodes, site, gateways and cloud. Their keys are in no history.

    Used in a ``with``. All stores have the same path, so that SQLAlchemy compiles each statement
    once for all runs, which would take a third of their time.

    Attributes:
        folder: Where runs have their files.
    """

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            temporary = tempfile.TemporaryDirectory(prefix="eskin-simulation-", dir=_memory())
            self.folder = Path(stack.enter_context(temporary))
            self._make(self.folder)
            module = "eskin_cloud.store.store"
            for engine in (writing_engine, reading_engine):
                stack.enter_context(patch(f"{module}.{engine.__name__}", cache(engine)))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.close()

    def _make(self, folder: Path) -> None:
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
        empty = folder / "empty.sqlite"
        Store(empty, threaded=False).close()
        self.empty_store = empty.read_bytes()
        self.store = folder / "store.sqlite"


def _memory() -> Path | None:
    """A file system in memory, where a synchronised commit costs little."""
    found = Path("/dev/shm")  # noqa: S108 - a folder of its own is made there
    return found if found.is_dir() else None
