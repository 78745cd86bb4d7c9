"""Broker, gateway and cloud as real processes on free ports, without the demo."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING, Self

from eskin.identity import IdentityKind
from tests.brokers import Mosquitto
from tests.files import ask, write_settings
from tests.identities import Identities
from tests.processes import ESKIN, Running, accepts, free_port

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

    def __init__(self, folder: Path, *, gateways: int = 1, keepalive_s: int = 15) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.pki = folder / "pki"
        self.identities = Identities(self.pki)
        self.identities.make(IdentityKind.SERVER, "server.cloud")
        self.store = folder / "store.sqlite"
        self.spool = folder / "spool.sqlite"
        self._ingest, people = free_port(), free_port()
        cloud_toml = write_settings(folder / "cloud.toml", {
            "store": {"path": self.store},
            "people": {"port": people},
            "gateways": {"port": self._ingest, "identity": self.pki / "server.cloud"},
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
            self.cloud.wait_for(lambda: accepts(self._ingest), "the cloud listens", seconds=60)
            for gateway in self.gateways:
                running.enter_context(gateway)
            for gateway in self.gateways:
                # Its imports are no part of what a block costs.
                gateway.wait_for(partial(_is_ready, gateway), "the gateway is ready", seconds=60)
            self._running = running.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._running.__exit__(kind, error, trace)

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

    def stored_blocks(self) -> int:
        """How many blocks the cloud has stored."""
        return int(ask(self.store, "SELECT count(*) FROM blocks")[0][0])


def _is_ready(gateway: Running) -> bool:
    return "ready:" in gateway.output()
