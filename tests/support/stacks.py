"""Broker, gateway and cloud as real processes on free ports, without the demo."""

from __future__ import annotations

from contextlib import ExitStack
from datetime import timedelta
from typing import TYPE_CHECKING, Self

import httpx
from eskin_cloud.access import Scope, create_token
from eskin_cloud.store import Store

from eskin.demo.ports import free_ports
from eskin.identity import IdentityKind
from tests.support.brokers import Mosquitto
from tests.support.files import ask, write_settings
from tests.support.identities import Identities
from tests.support.processes import ESKIN, PLAIN, Running, accepts, free_port

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from types import TracebackType


class RealStack:
    """Mosquitto, gateways and cloud.

    Args:
        folder: Where all lies.
        gateways: How many; several share the site's load.
        keepalive_s: Seconds between a gateway's pings.
        missing_s: Seconds after which the cloud names missing messages.

    Attributes:
        folder: Where all lies.
        pki: Folder of all identities.
        identities: The CA.
        broker: Mosquitto.
        gateways: All of them.
        gateway: The first.
        cloud: The cloud.
        store: The cloud's database.
        spool: The first gateway's.
    """

    def __init__(
        self,
        folder: Path,
        *,
        gateways: int = 1,
        keepalive_s: int = 15,
        missing_s: float = 300.0,
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.pki = folder / "pki"
        self.identities = Identities(self.pki)
        self.identities.make(IdentityKind.SERVER, "server.cloud")
        self.store = folder / "store.sqlite"
        self.spool = folder / "spool.sqlite"
        self._ingest, self._people = free_ports(2)
        cloud_toml = write_settings(folder / "cloud.toml", {
            "store": {"path": self.store},
            "people": {"port": self._people},
            "gateways": {"port": self._ingest, "identity": self.pki / "server.cloud"},
            "nodes": {"missing_s": missing_s},
        })  # fmt: skip
        self.broker = Mosquitto(folder / "broker", self.identities)
        self.cloud = Running(
            [ESKIN, "cloud", "--config", str(cloud_toml)], log=folder / "cloud.log"
        )
        broker = {"host": "127.0.0.1", "port": self.broker.gateway_port, "keepalive_s": keepalive_s,
                  "group": "site" if gateways > 1 else ""}  # fmt: skip
        self.gateways = [self._make_gateway(n, broker) for n in range(1, gateways + 1)]
        self.gateway = self.gateways[0]
        self._running = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as running:
            running.enter_context(self.broker)
            running.enter_context(self.cloud)
            self.cloud.wait_for(lambda: accepts(self._ingest), "the cloud listens")
            for gateway in self.gateways:
                running.enter_context(gateway)
            for gateway in self.gateways:
                _await_ready(gateway, 1)
            self._running = running.pop_all()
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
        return httpx.Client(base_url=url, headers=headers, timeout=60, verify=PLAIN)

    def start_cloud(self) -> None:
        """Start the cloud again, after it was ended."""
        self.cloud.start()
        self.cloud.wait_for(lambda: accepts(self._ingest), "the cloud listens")

    def start_gateway(self) -> None:
        """Start the gateway again, after it was ended."""
        starts = self.gateway.output().count("ready:")
        self.gateway.start()
        _await_ready(self.gateway, starts + 1)

    def _make_gateway(self, number: int, broker: Mapping[str, object]) -> Running:
        own = self.identities.make(IdentityKind.GATEWAY, f"gateway.g{number}")
        spool = self.spool if number == 1 else self.folder / f"spool-{number}.sqlite"
        config = write_settings(self.folder / f"gateway-{number}.toml", {
            "broker": broker,
            "identity": {"directory": own.directory, "site": self.pki / "site.main"},
            "cloud": {"url": f"https://127.0.0.1:{self._ingest}/api/v1/ingest"},
            "spool": {"path": spool},
            "http": {"port": free_port()},
        })  # fmt: skip
        log = self.folder / f"gateway-{number}.log"
        return Running([ESKIN, "gateway", "--config", str(config)], log=log)

    def stored_frames(self) -> int:
        """How many frames the cloud has stored."""
        return int(ask(self.store, "SELECT coalesce(sum(frames), 0) FROM pages")[0][0])

    def stored_blocks(self) -> int:
        """How many blocks the cloud has stored."""
        return int(ask(self.store, "SELECT coalesce(sum(blocks), 0) FROM channels")[0][0])


def _await_ready(gateway: Running, starts: int) -> None:
    """Its imports are no part of what a block costs."""
    ready = "the gateway is ready"
    gateway.wait_for(lambda: gateway.output().count("ready:") >= starts, ready)
