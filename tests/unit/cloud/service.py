"""A cloud as a process, for tests."""

from __future__ import annotations

import sys
from datetime import timedelta
from typing import TYPE_CHECKING, Any, Final

import cbor2
import httpx
from eskin_cloud.access import Scope, create_token
from eskin_cloud.store import Store

from eskin.demo.ports import free_ports
from eskin.identity import IdentityKind, client_context, der
from tests.support.processes import PLAIN, Running
from tests.support.stores import write_place
from tests.unit.cloud.clouds import pairs_in, skins_behind
from tests.unit.cloud.messages import SKINS

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from tests.support.identities import Identities

PATIENCE_S: Final = 60.0
"""For so long an answer may take, where others use the machine, too."""
PROGRAM = """
import sys, pathlib
from eskin_cloud.service import run
from eskin_cloud.settings import CloudSettings
from eskin.runtime.logs import start_logs
from eskin.errors import EskinError
try:
    settings = CloudSettings.load(pathlib.Path(sys.argv[1]))
    start_logs(settings.log.level)
    run(settings)
except EskinError as error:
    sys.exit(f"eskin: {error}")
"""


class Service(Running):
    """A cloud process on free ports."""

    def __init__(
        self,
        folder: Path,
        identities: Identities,
        *,
        more: str = "",
        place: StoreLocation | None = None,
    ) -> None:
        self.server = identities.make(IdentityKind.SERVER, "server.cloud")
        self.gateway = identities.gateway
        self._identities = identities
        self._admitted: set[str] = set()
        self.port, self.ingest_port = free_ports(2)
        self.place = place or folder / "data" / "store.sqlite"
        folder.mkdir(exist_ok=True)
        config = folder / "cloud.toml"
        store = "".join(f"{name} = '{value}'\n" for name, value in write_place(self.place).items())
        config.write_text(
            f"[store]\n{store}"
            f"[people]\nport = {self.port}\n{more}"
            f"[gateways]\nport = {self.ingest_port}\nidentity = '{self.server.directory}'\n"
        )
        super().__init__([sys.executable, "-c", PROGRAM, str(config)], log=folder / "cloud.log")

    def start(self) -> None:
        """Start, and wait until it is ready."""
        self.begin()
        self.wait_until_ready()

    def begin(self) -> None:
        """Start."""
        super().start()

    def wait_until_ready(self) -> None:
        """Wait until it answers."""
        self.wait_for(lambda: "ready: people=" in self.output(), "the cloud is ready")

    def token(self, *scopes: Scope) -> str:
        """A token, by default a reader's, made beside the running cloud."""
        named = scopes or (Scope.READ,)
        with Store(self.place) as store:
            return create_token(store, scopes=named, name="t", lifetime=timedelta(hours=1))

    def people(self, token: str) -> httpx.Client:
        """A reader."""
        headers = {"Authorization": f"Bearer {token}"}
        url = f"http://127.0.0.1:{self.port}"
        return httpx.Client(base_url=url, headers=headers, timeout=PATIENCE_S, verify=PLAIN)

    def gateway_client(self, **options: Any) -> httpx.Client:
        """A gateway's client, which shows its certificate."""
        context = client_context(self.server.directory / "root.pem", self.gateway)
        url = f"https://localhost:{self.ingest_port}"
        headers = {"Content-Type": "application/cbor"}
        kept = {"base_url": url, "headers": headers, "timeout": PATIENCE_S, "verify": context}
        return httpx.Client(**{**kept, **options})

    def admit(self, *nodes: str) -> None:
        """Present certificates of nodes, each once."""
        fresh = [node for node in dict.fromkeys(nodes) if node not in self._admitted]
        if not fresh:
            return
        made = [self._identities.make(IdentityKind.NODE, node) for node in fresh]
        chains = [[der(part) for part in own.chain] for own in made]
        with self.gateway_client() as client:
            answer = client.post("/api/v1/certificates", content=cbor2.dumps(chains))
        assert {item["reason"] for item in answer.json()["items"]} == {None}, answer.text
        self._admitted.update(fresh)

    def ingest(self, body: bytes) -> httpx.Response:
        """Bring a batch, of nodes whose certificates were presented."""
        pairs = pairs_in(body)
        self.admit(*(node for node, _ in pairs))
        skins = skins_behind(pairs)
        described = [[node, each.encode()] for node, name in skins for each in SKINS[name]]
        with self.gateway_client() as client:
            if described:
                client.post("/api/v1/descriptions", content=cbor2.dumps(described))
            return client.post("/api/v1/ingest", content=body)
