"""Broker, gateways and clouds as real processes on free ports, without the demo."""

from __future__ import annotations

from contextlib import ExitStack
from datetime import timedelta
from typing import TYPE_CHECKING, Self

import httpx
from eskin_cloud.access import Scope, create_token
from eskin_cloud.store import Store

from eskin.demo.ports import free_ports
from eskin.identity import Identity, IdentityKind, client_context
from eskin.identity.identity import CHAIN_FILE, ROOT_FILE
from tests.support.brokers import Mosquitto
from tests.support.files import ask, write_settings
from tests.support.identities import Identities
from tests.support.processes import ESKIN, PLAIN, Running, accepts, free_port
from tests.support.stores import write_place

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from types import TracebackType

    from eskin_cloud.store.location import StoreLocation


class RealStack:
    """Mosquitto, gateways and clouds.

    Args:
        folder: Where all lies.
        gateways: How many; several share the site's load.
        clouds: How many; each gateway knows all of them, and begins with one of its own.
        place: The clouds' store; an SQLite file else.
        keepalive_s: Seconds between a gateway's pings.
        missing_s: Seconds after which the cloud names missing messages.

    Attributes:
        folder: Where all lies.
        pki: Folder of all identities.
        identities: The CA.
        broker: Mosquitto.
        gateways: All of them.
        gateway: The first.
        clouds: All of them.
        cloud: The first.
        store: The clouds' database, where it is SQLite.
        spools: Those of the gateways.
        spool: The first gateway's.
    """

    def __init__(
        self,
        folder: Path,
        *,
        gateways: int = 1,
        clouds: int = 1,
        place: StoreLocation | None = None,
        keepalive_s: int = 15,
        missing_s: float = 300.0,
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.pki = folder / "pki"
        self.identities = Identities(self.pki)
        self.identities.make(IdentityKind.SERVER, "server.cloud")
        self.store = folder / "store.sqlite"
        self.place: StoreLocation = place or self.store
        self.spools = [
            folder / f"spool{'' if n == 1 else f'-{n}'}.sqlite" for n in range(1, gateways + 1)
        ]
        self.spool = self.spools[0]
        self._ports = [free_ports(2) for _ in range(clouds)]
        self.broker = Mosquitto(folder / "broker", self.identities)
        self.clouds = [self._make_cloud(number, missing_s) for number in range(clouds)]
        self.cloud = self.clouds[0]
        broker = {"host": "127.0.0.1", "port": self.broker.gateway_port, "keepalive_s": keepalive_s,
                  "group": "site" if gateways > 1 else ""}  # fmt: skip
        self.gateways = [self._make_gateway(n, broker) for n in range(1, gateways + 1)]
        self.gateway = self.gateways[0]
        self._running = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as running:
            running.enter_context(self.broker)
            for cloud in self.clouds:
                running.enter_context(cloud)
            for number in range(len(self.clouds)):
                self._await_cloud(number)
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

    def sensor_node(self, name: str = "") -> Running:
        """A fingertip that sends 20 frames a second; not started.

        Args:
            name: Its name, where there are several; else ``fingertip``.
        """
        own, folder = self.identities.node, self.folder
        if name:
            own, folder = self.identities.make(IdentityKind.NODE, name), self.folder / name
            folder.mkdir()
        config = write_settings(folder / "node.toml", {
            "node": {"name": own.name, "profile": "fingertip"},
            "sampling": {"stretch_ms": 50.0},
            "broker": {"host": "127.0.0.1", "port": self.broker.node_port, "drain_s": 90.0},
            "identity": {"directory": own.directory,
                         "site": self.identities.site.directory / CHAIN_FILE},
            "flash": {"path": folder / "flash.sqlite"},
            "truth": {"path": folder / "truth.sqlite"},
        })  # fmt: skip
        return Running([ESKIN, "node", "--config", str(config)], log=folder / "node.log")

    def token(self) -> str:
        """A token of a person who may give commands."""
        scopes = [Scope.READ, Scope.OPERATE]
        with Store(self.place) as store:
            return create_token(store, scopes=scopes, name="o", lifetime=timedelta(hours=1))

    def operator(self, cloud: int = 0, token: str | None = None) -> httpx.Client:
        """A person who may give commands, at one of the clouds."""
        headers = {"Authorization": f"Bearer {token or self.token()}"}
        url = f"http://127.0.0.1:{self._ports[cloud][1]}/api/v1"
        # Without the environment, which pytest changes while a viewer's thread would read it.
        return httpx.Client(
            base_url=url, headers=headers, timeout=60, verify=PLAIN, trust_env=False
        )

    def gateway_client(self, cloud: int = 0) -> httpx.Client:
        """A client with the first gateway's certificate, at one of the clouds."""
        own = Identity.load(self.pki / "gateway.g1")
        context = client_context(self.pki / "server.cloud" / ROOT_FILE, own)
        url = f"https://127.0.0.1:{self._ports[cloud][0]}/api/v1"
        headers = {"Content-Type": "application/cbor"}
        return httpx.Client(base_url=url, headers=headers, timeout=60, verify=context)

    def start_cloud(self, number: int = 0) -> None:
        """Start a cloud again, after it was ended."""
        self.clouds[number].start()
        self._await_cloud(number)

    def _await_cloud(self, number: int) -> None:
        port = self._ports[number][0]
        self.clouds[number].wait_for(lambda: accepts(port), "the cloud listens")

    def _make_cloud(self, number: int, missing_s: float) -> Running:
        ingest, people = self._ports[number]
        name = "cloud" if number == 0 else f"cloud-{number + 1}"
        config = write_settings(self.folder / f"{name}.toml", {
            "store": write_place(self.place),
            "people": {"port": people},
            "gateways": {"port": ingest, "identity": self.pki / "server.cloud"},
            "nodes": {"missing_s": missing_s},
        })  # fmt: skip
        return Running([ESKIN, "cloud", "--config", str(config)], log=self.folder / f"{name}.log")

    def start_gateway(self, number: int = 0) -> None:
        """Start a gateway again, after it was ended."""
        gateway = self.gateways[number]
        starts = gateway.output().count("ready:")
        gateway.start()
        _await_ready(gateway, starts + 1)

    def _make_gateway(self, number: int, broker: Mapping[str, object]) -> Running:
        own = self.identities.make(IdentityKind.GATEWAY, f"gateway.g{number}")
        first = (number - 1) % len(self._ports)
        ports = self._ports[first:] + self._ports[:first]
        urls = [f"https://127.0.0.1:{ingest}/api/v1/ingest" for ingest, _ in ports]
        spool = self.spools[number - 1]
        config = write_settings(self.folder / f"gateway-{number}.toml", {
            "broker": broker,
            "identity": {"directory": own.directory, "site": self.pki / "site.main"},
            "cloud": {"url": urls[0], "fallbacks": urls[1:]},
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
