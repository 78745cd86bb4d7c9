"""Broker, gateway and cloud as real processes on free ports, without the demo."""

from __future__ import annotations

from contextlib import ExitStack
from datetime import timedelta
from typing import TYPE_CHECKING, Self

import httpx

from cloud.access import Scope, create_token
from cloud.store import Store
from eskin.identity import IdentityKind
from tests.brokers import Mosquitto
from tests.files import ask, write_settings
from tests.identities import Identities
from tests.processes import ESKIN, Running, accepts, free_port

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType


class RealStack:
    """Mosquitto, gateway and cloud.

    Attributes:
        folder: Where all lies.
        pki: Folder of all identities.
        identities: The CA.
        broker: Mosquitto.
        gateway: The gateway.
        cloud: The cloud.
        store: The cloud's database.
        spool: The gateway's.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.pki = folder / "pki"
        self.identities = Identities(self.pki)
        self.identities.make(IdentityKind.SERVER, "server.cloud")
        self.store = folder / "store.sqlite"
        self.spool = folder / "spool.sqlite"
        self._ingest, self._people = free_port(), free_port()
        cloud_toml = write_settings(folder / "cloud.toml", {
            "store": {"path": self.store},
            "people": {"port": self._people},
            "gateways": {"port": self._ingest, "identity": self.pki / "server.cloud"},
        })  # fmt: skip
        self.broker = Mosquitto(folder / "broker", self.identities)
        gateway_toml = write_settings(folder / "gateway.toml", {
            "broker": {"host": "127.0.0.1", "port": self.broker.gateway_port},
            "identity": {"directory": self.pki / "gateway.g1", "site": self.pki / "site.main"},
            "cloud": {"url": f"https://127.0.0.1:{self._ingest}/api/v1/ingest"},
            "spool": {"path": self.spool},
            "http": {"port": free_port()},
        })  # fmt: skip
        self.cloud = Running(
            [ESKIN, "cloud", "--config", str(cloud_toml)], log=folder / "cloud.log"
        )
        self.gateway = Running(
            [ESKIN, "gateway", "--config", str(gateway_toml)], log=folder / "gateway.log"
        )
        self._running = ExitStack()

    def __enter__(self) -> Self:
        self._running.enter_context(self.broker)
        self._running.enter_context(self.cloud)
        self.cloud.wait_for(lambda: accepts(self._ingest), "the cloud listens", seconds=60)
        self._running.enter_context(self.gateway)
        self._await_gateway(1)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._running.__exit__(kind, error, trace)

    def operator(self) -> httpx.Client:
        """A person who may give commands."""
        scopes = [Scope.READ, Scope.OPERATE]
        with Store(self.store) as store:
            token = create_token(store, scopes=scopes, name="o", lifetime=timedelta(hours=1))
        headers = {"Authorization": f"Bearer {token}"}
        url = f"http://127.0.0.1:{self._people}/api/v1"
        return httpx.Client(base_url=url, headers=headers, timeout=20)

    def start_gateway(self) -> None:
        """Start the gateway again, after it was ended."""
        starts = self.gateway.output().count("ready:")
        self.gateway.start()
        self._await_gateway(starts + 1)

    def _await_gateway(self, starts: int) -> None:
        # Its imports are no part of what a block costs.
        ready = "the gateway is ready"
        self.gateway.wait_for(
            lambda: self.gateway.output().count("ready:") >= starts, ready, seconds=60
        )

    def stored_blocks(self) -> int:
        """How many blocks the cloud has stored."""
        return int(ask(self.store, "SELECT count(*) FROM blocks")[0][0])
