"""The cloud's SQLite store: all that people and gateways are answered from it."""

from __future__ import annotations

import asyncio
import csv
import io
import logging
import shutil
import sqlite3
from contextlib import closing, contextmanager
from datetime import timedelta
from functools import cache, partial
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, Final

import cbor2
import httpx
from eskin_cloud.access import Scope, create_token
from eskin_cloud.access.sessions import open_session
from eskin_cloud.access.tokens import digest, revoke_token, token_id
from eskin_cloud.api.middleware.answer import DAMAGED
from eskin_cloud.jobs.integrity import look_at
from eskin_cloud.service import make_cloud
from eskin_cloud.settings import CloudSettings, GatewaysSection, StoreSection
from eskin_cloud.store import Store
from eskin_cloud.store.integrity import LARGE_TABLES

from eskin.errors import EskinError, StoreError
from eskin.identity import IdentityKind
from eskin.runtime.settings import KeysSection
from eskin.wire.timestamp import SECOND, parse_timestamp
from tests.robustness.bitflips.part import Part
from tests.support.identities import Identities
from tests.unit.cloud.clouds import Clock, PlainIds, Stand, batch
from tests.unit.cloud.everything import BUILT, PACKED, fill
from tests.unit.cloud.messages import CHANNEL, NODE, START, gap, peak, stretch
from tests.unit.cloud.orders import fetch, opened
from tests.unit.cloud.sealing import NODE as HAND
from tests.unit.cloud.sealing import Site, sealing

if TYPE_CHECKING:
    from collections.abc import Iterator

log = logging.getLogger("eskin_cloud.bitflips")

_STORE: Final = "store.sqlite"
WINDOW: Final = {"start": START - SECOND, "end": START + 3600 * SECOND}
_PLACES: Final = ((NODE, CHANNEL), (NODE, PACKED), (NODE, BUILT), (HAND, "t05.bioelectric"))
_LISTS: Final = (
    "nodes",
    *(f"nodes/{node}/{what}" for node in (NODE, HAND) for what in ("channels", "taxels")),
    "events",
    "gateways",
    "tokens",
    "sessions",
    "audit-log",
    "subjects",
)
_ONES: Final = (f"nodes/{NODE}/state", f"nodes/{NODE}", f"nodes/{HAND}")
_ALL: Final = tuple(Scope)


@cache
def identities() -> Identities:
    """A CA, a gateway and a cloud."""
    made = Identities(Path(mkdtemp(prefix="eskin-bitflips-")))
    made.make(IdentityKind.SERVER, "server.cloud")
    return made


def make(folder: Path) -> None:
    """A store with something in every table, and all kinds of secrets."""
    asyncio.run(_make(folder))
    with closing(sqlite3.connect(folder / _STORE)) as db:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")


async def _make(folder: Path) -> None:
    with sealing(folder, identities()) as stand:
        store = stand.cloud.store
        token = partial(create_token, store, scopes=_ALL, lifetime=timedelta(days=9))
        secrets = {name: token(name=name) for name in ("good", "revoked", "closed")}
        secrets["expired"] = token(name="expired", lifetime=timedelta(seconds=1))
        for name in ("good", "closed"):
            written = open_session(store, secrets[name], lifetime=9 * 3600 * SECOND, address="")
            assert written is not None
            secrets[f"session of {name}"] = written.result(60)
        await fill(stand, Site(folder))
        values = [[1.0 + k] for k in range(40)]
        said = [
            stretch(300 + k, v, [v[0] + 0.5], time=(START + k * SECOND,) * 2, dt=SECOND)
            for k, v in enumerate(values)
        ]
        await stand.ingest(batch(*said, peak(400), gap(401)))
        for name in ("revoked", "closed"):
            assert revoke_token(store, token_id(digest(secrets[name])))
        (folder / "secrets").write_bytes(cbor2.dumps(secrets))
        for left in (folder / "site", folder / "dashboard"):
            shutil.rmtree(left, ignore_errors=True)


@contextmanager
def standing(folder: Path, token: str) -> Iterator[Stand]:
    """A cloud on a store, which has looked for damage."""
    server = identities().ca.parent / "server.cloud"
    settings = CloudSettings(
        store=StoreSection(path=folder / _STORE),
        gateways=GatewaysSection(identity=server),
        keys=KeysSection(directory=folder / "cloud-keys"),
    )
    clock = Clock(START + 2 * 3600 * SECOND)
    with Store(folder / _STORE, clock=clock) as store:
        cloud = make_cloud(settings, store, clock=clock, dashboard=folder)
        cloud.feed.ids = cloud.feed.encoder.ids = PlainIds(bytes(32))
        for table in LARGE_TABLES:
            try:
                look_at(store, table)
            except StoreError as error:
                log.warning("%s", error)
        yield Stand(cloud, clock, identities().gateway, token, {NODE, HAND})


def read(folder: Path) -> dict[str, Any]:
    """Ask everything, of everybody, and bring what was brought before."""
    secrets = cbor2.loads((folder / "secrets").read_bytes())
    with standing(folder, secrets["good"]) as stand:
        return asyncio.run(Asker(stand, secrets).ask())


class Asker:
    """Asks a cloud, and keeps each part of its answers by itself."""

    def __init__(self, stand: Stand, secrets: dict[str, str]) -> None:
        self.stand = stand
        self._secrets = secrets
        self.found: dict[str, Any] = {}

    async def ask(self) -> dict[str, Any]:
        """Ask everything; gives what was found."""
        await self._ask_secrets()
        for path in _LISTS:
            for item in (await self.get(path) or {}).get("items", ()):
                self.keep(f"{path} {item.get('id', item)}", item)
        for path in _ONES:
            self.keep(path, await self.get(path))
        for node, channel in _PLACES:
            await self.ask_series(node, channel)
        await self._fetch()
        await self._bring()
        return self.found

    def keep(self, name: str, value: Any) -> None:
        """Keep each part of an answer by itself; what says nothing is left out."""
        if isinstance(value, dict):
            for part, inner in value.items():
                self.keep(f"{name} {part}", inner)
        elif isinstance(value, list):
            for part, inner in enumerate(value):
                self.keep(f"{name} {part}", inner)
        elif value is not None and not name.endswith(" settled"):  # which follows from the rest
            self.found[name] = value

    async def get(self, path: str, **params: Any) -> Any:
        """The answer in JSON; ``None`` where there is none, which is logged."""
        answer = await self.answer(path, **params)
        return None if answer is None else answer.json()

    async def answer(self, path: str, **params: Any) -> httpx.Response | None:
        """The answer; ``None`` where there is none, which is logged, as what it lacks is."""
        answer = await self.stand.get(f"/api/v1/{path}", **params)
        assert answer.status_code != 500, f"500 at {path}"
        if answer.status_code != 200:
            log.error("%s: %s", path, answer.json()["detail"])
            return None
        if DAMAGED in answer.headers:
            log.error("%s lacks %s", path, answer.headers[DAMAGED])
        return answer

    async def _ask_secrets(self) -> None:
        for name, secret in self._secrets.items():
            is_session = name.startswith("session")
            async with self.stand.client(token="" if is_session else secret) as client:
                cookies = (
                    {f"eskin_session_{self.stand.cloud.settings.people.port}": secret}
                    if is_session
                    else None
                )
                client.cookies = httpx.Cookies(cookies)
                answer = await client.get("/api/v1/nodes")
            assert answer.status_code != 500, f"500 for {name}"
            if answer.status_code == 200:
                self.found[f"{name} may"] = True
            else:
                log.error("%s: %s", name, answer.json()["detail"])

    async def ask_series(self, node: str, channel: str) -> None:
        """Read a channel as hulls, in all samples, and as a file."""
        path = f"series/{node}/{channel}"
        for points in (3, 20_000):
            answer = await self.answer(path, points=points, **WINDOW)
            if answer is None or (points == 3 and DAMAGED in answer.headers):
                continue
            said = answer.json()
            begin = 0 if points == 3 else parse_timestamp(said["t0"])
            said["t"] = [begin + t for t in said["t"]]
            for instant, *bounds in zip(said["t"], said["lo"], said["hi"], strict=True):
                if bounds != [None, None]:
                    self.found[f"{channel} by {points} at {instant}"] = bounds
        try:
            answer = await self.answer("export", channel=f"{node}/{channel}", **WINDOW)
        except AssertionError:  # httpx's: the answer was broken off
            log.warning("export: broken off")
            return
        if answer is not None:
            for row in csv.DictReader(io.StringIO(answer.text)):
                if not row["lo"] and not row["hi"]:
                    log.error("export: unknown %s", row)
                    continue
                key = tuple(row[name] for name in ("boot", "sequence", "earliest"))
                self.found[f"export {channel} {key}"] = row

    async def _fetch(self) -> None:
        answer = await fetch(self.stand)
        assert answer.status_code != 500, "500 at deliveries"
        if answer.status_code != 200:
            log.error("deliveries: %s", answer.json()["detail"])
            return
        for node, number, data in cbor2.loads(answer.content)["give"]:
            try:
                self.found[f"command {node} {number}"] = opened(identities(), data, node).encode()
            except EskinError as error:  # as the node says
                log.warning("command refused by its node: %s", error)

    async def _bring(self) -> None:
        old = (peak(1), gap(2), stretch(3), peak(400), gap(401))
        for said in (*old, stretch(500), peak(501)):
            await self.bring(said)

    async def bring(self, said: Any) -> None:
        """Bring a message, perhaps again."""
        answer = await self.stand.ingest(batch(said))
        assert answer.status_code != 500, "500 at ingest"
        if answer.status_code != 200:
            log.error("ingest: %s", answer.json()["detail"])
            return
        result = answer.json()["items"][0]["result"]
        name = f"brought {said.position}"
        if result in {"rejected", "unknown_node", "unknown_layout"}:
            log.error("%s: %s", name, answer.json()["items"][0]["reason"])
            return
        self.found[name] = result


PART: Final = Part(make, read, (_STORE,))
