"""Clouds for tests: a store and both applications, over ASGI without sockets."""

from __future__ import annotations

import json
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import timedelta
from functools import cached_property, partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Protocol

import cbor2
import httpx
from cryptography.hazmat.primitives.serialization import Encoding
from eskin_cloud.access import Scope, create_token
from eskin_cloud.app import gateway_application, people_application
from eskin_cloud.ingest.gateway_status import HEADER
from eskin_cloud.query.opaque_ids import OpaqueIds, UnknownCursorError
from eskin_cloud.service import make_cloud
from eskin_cloud.settings import CloudSettings, GatewaysSection, StoreSection
from eskin_cloud.store import Store
from eskin_cloud.store.descriptions import Description, read_description, store_descriptions
from eskin_cloud.store.feed_entry import FEED_START, FeedPosition
from eskin_cloud.store.schema.alarm_tables import alarm_state
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.schema.tables import audit_log, feed, metadata, versions
from eskin_cloud.store.write.ingest import IngestResult, ingest, ingest_individually
from eskin_cloud.store.write.node_sites import store_sites
from eskin_cloud.store.write.parsed_message import ParsedMessage
from sqlalchemy import delete, func, select, update

from eskin.identity import IdentityKind
from eskin.wire.slot import SLOTS, in_order, slot_of
from eskin.wire.timestamp import SECOND
from tests.support.identities import SITE
from tests.unit.cloud.messages import NODE, SKINS, START

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from eskin_cloud.app_state import AppState
    from eskin_cloud.store.location import StoreLocation
    from eskin_cloud.store.write.write_cache import WriteCache
    from fastapi import FastAPI
    from sqlalchemy import Connection
    from starlette import types as asgi

    from eskin.identity import Identity
    from tests.support.identities import Identities


class Said(Protocol):
    """Anything that a node says."""

    def encode(self) -> bytes:
        """Its bytes."""
        ...


class Clock:
    """A clock that stands until it is turned."""

    def __init__(self, now: int) -> None:
        self.now = now

    def __call__(self) -> int:
        """UTC ns."""
        return self.now

    def turn(self, seconds: float) -> None:
        """Let time pass."""
        self.now += int(seconds * SECOND)


def skins_behind(pairs: Iterable[tuple[str, bytes]]) -> set[tuple[str, bytes]]:
    """Nodes, and hashes of the layouts of one channel (`messages.skin_of`) in their messages."""
    return {(node, name) for node, data in pairs for name in SKINS if name in data}


def present(connection: Connection, cache: WriteCache, items: Sequence[ParsedMessage]) -> None:
    """Store what describes messages of one channel, as if it had been sent ahead."""
    for node, name in skins_behind((item.node, item.data) for item in items):
        if not cache.is_accepted(node, name):
            described = [read_description(each.encode()) for each in SKINS[name]]
            store_descriptions(connection, node, described)


def put(store: Store, *messages: Said, node: str = NODE, dead_letters: int = 100) -> IngestResult:
    """Store messages in one batch."""
    items = [ParsedMessage.parse(node, message.encode()) for message in messages]
    return put_items(store, items, dead_letters=dead_letters)


def admit(store: Store, *nodes: str, site: str = SITE) -> None:
    """Have the store know nodes of a site, as if their certificates had been presented."""

    def work(ours: list[str], connection: Connection, cache: WriteCache) -> None:
        del cache
        named = [(node, b"") for node in ours]
        store_sites(connection, named, site=site, gateway="gateway.g1", now=store.clock())

    for each in store.shares(dict.fromkeys(nodes), str):
        store.write_slots(each.slots, partial(work, each.items)).result(120)


def position(number: int, node: str = NODE) -> FeedPosition:
    """The position in the feed after so many entries of a node's slot, and none of others."""
    return FEED_START.advance([number * SLOTS + slot_of(node)])


def numbers(cursors: Iterable[int]) -> list[int]:
    """The numbers of cursors within their slots."""
    return [cursor // SLOTS for cursor in cursors]


def pairs_in(body: bytes) -> list[tuple[str, bytes]]:
    """Nodes and messages in the body of an ingest, as far as it is one."""
    try:
        said = cbor2.loads(body)
        return [(node, data) for node, data in filter(is_pair, said)]
    except (cbor2.CBORError, ValueError, TypeError, LookupError, OverflowError):
        return []


def is_pair(item: Any) -> bool:
    """Whether an item of a batch is a node's name and a message."""
    return isinstance(item, list) and list(map(type, item)) == [str, bytes] and bool(item[0])


def put_items(
    store: Store,
    items: Sequence[ParsedMessage],
    *,
    dead_letters: int = 100,
    described: bool = False,
) -> IngestResult:
    """Store items in one batch, each group of slots in its transaction, as the cloud does.

    Args:
        store: The store.
        items: The batch.
        dead_letters: Most dead letters that are kept.
        described: Whether what describes them is stored; else it is stored first, and an error
            is raised rather than a dead letter stored.
    """

    def work(
        take: Callable[..., IngestResult],
        ours: Sequence[ParsedMessage],
        connection: Connection,
        cache: WriteCache,
    ) -> IngestResult:
        if not described:
            present(connection, cache, ours)
        now = store.clock()
        gateway = "gateway.g1"
        return take(connection, cache, ours, gateway=gateway, now=now, dead_letters=dead_letters)

    shares = store.shares(items, attrgetter("node"))
    futures = [
        store.write_slots(
            each.slots,
            partial(work, ingest, each.items),
            fallback=partial(work, ingest_individually, each.items) if described else None,
            shared=True,
        )
        for each in shares
    ]
    found = [future.result(120) for future in futures]
    return IngestResult(
        results=in_order(shares, [each.results for each in found]),
        entries=[entry for each in found for entry in each.entries],
        dropped=sum(each.dropped for each in found),
        lag=next((each.lag for each in reversed(found) if each.lag is not None), None),
        conflicts=sum(each.conflicts for each in found),
    )


def cached_rows(store: Store) -> int:
    """How many rows the writer of the usual node has cached."""
    return store.write_node(NODE, lambda _, cache: len(cache)).result(120)


def emptied(store: Store) -> Store:
    """Empty a store, except its audit log, for the next example of a property."""

    def clear(connection: Connection) -> None:
        for table in metadata.sorted_tables:
            if table not in {versions, feed, alarm_state, audit_log}:
                connection.execute(delete(table))
        connection.execute(update(alarm_state).values(holder=None, until=0))
        connection.execute(
            update(feed).values(cursor=feed.c.slot, compacted=feed.c.slot, writer=None)
        )

    store.write(clear).result(120)
    return store


def forget_recent(stand: Stand) -> None:
    """Have streams read all from the store, as those that are far behind do."""
    feed = stand.cloud.feed
    feed._recent.clear()
    feed._floor = feed.last


def shown_certificate(app: asgi.ASGIApp, identity: Identity | None) -> asgi.ASGIApp:
    """An application whose clients show a certificate, as the listener passes it on."""
    pem = [part.public_bytes(Encoding.PEM).decode() for part in identity.chain] if identity else []

    async def shown(scope: asgi.Scope, receive: asgi.Receive, send: asgi.Send) -> None:
        more = {"extensions": {"tls": {"client_cert_chain": tuple(pem)}}}
        await app({**scope, **more}, receive, send)

    return shown


def batch(*messages: Said, node: str = NODE) -> bytes:
    """The body of an ingest."""
    return cbor2.dumps([[node, message.encode()] for message in messages])


@dataclass
class Stand:
    """A cloud with clients for both of its faces."""

    cloud: AppState
    clock: Clock
    gateway: Identity | None
    token: str
    admitted: set[str] = field(default_factory=lambda: {NODE})
    described: set[tuple[str, bytes]] = field(default_factory=set)

    @cached_property
    def people(self) -> FastAPI:
        return people_application(self.cloud)

    def client(self, *, token: str | None = None, **options: Any) -> httpx.AsyncClient:
        """A person's client, with a reading token unless another is given ('' for none)."""
        chosen = self.token if token is None else token
        headers = {"Authorization": f"Bearer {chosen}"} if chosen else {}
        transport = httpx.ASGITransport(self.people, raise_app_exceptions=False, **options)
        return httpx.AsyncClient(transport=transport, base_url="http://cloud", headers=headers)

    def ingest_client(self) -> httpx.AsyncClient:
        """A gateway's client."""
        app = shown_certificate(gateway_application(self.cloud), self.gateway)
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        headers = {"Content-Type": "application/cbor"}
        return httpx.AsyncClient(transport=transport, base_url="https://ingest", headers=headers)

    async def ingest(self, body: bytes, *, status: Any = None) -> httpx.Response:
        """Bring a batch as the gateway does, with its status where there is one."""
        headers = {} if status is None else {HEADER: json.dumps(status)}
        fresh = {node for node, _ in pairs_in(body)} - self.admitted
        if fresh:
            admit(self.cloud.store, *fresh)
            self.admitted |= fresh
        self.present(body)
        async with self.ingest_client() as client:
            answer = await client.post("/api/v1/ingest", content=body, headers=headers)
        await self.cloud.gateway_contacts.written()
        return answer

    def present(self, body: bytes) -> None:
        """Store what describes a batch's messages of one channel, as the gateway posts it."""
        skins = skins_behind(pairs_in(body)) - self.described
        self.described |= skins
        for node, name in skins:
            described = [read_description(each.encode()) for each in SKINS[name]]

            def work(
                connection: Connection,
                cache: WriteCache,
                node: str = node,
                described: list[Description] = described,
            ) -> None:
                del cache
                store_descriptions(connection, node, described)

            self.cloud.store.write_node(node, work).result(120)

    async def get(self, path: str, **params: Any) -> httpx.Response:
        """Ask as a reader."""
        async with self.client() as client:
            return await client.get(path, params=params)


class PlainIds(OpaqueIds):
    """Ids as the plain numbers that they name, so that tests can count; `OpaqueIds` has its own."""

    def write(self, *numbers: int) -> str:
        return ".".join(map(str, numbers))

    def write_position(self, position: FeedPosition) -> str:
        return str(position.total)

    def read_position(self, text: str) -> FeedPosition:
        (number,) = self.read(text, 1)
        return position(number)

    def read(self, text: str, count: int) -> list[int]:
        try:
            numbers = [int(part) for part in text.split(".")]
        except ValueError:
            numbers = []
        # What a cloud has encrypted is a number of rows.
        if len(numbers) != count or not all(0 <= number < 1 << 63 for number in numbers):
            raise UnknownCursorError
        return numbers


@contextmanager
def standing(
    folder: Path, identities: Identities, *, place: StoreLocation | None = None, **sections: Any
) -> Iterator[Stand]:
    """A cloud in a folder, with its store there or elsewhere."""
    server = identities.make(IdentityKind.SERVER, "server.cloud")
    settings = CloudSettings(
        store=sections.pop("store", StoreSection(path=folder / "store.sqlite")),
        gateways=sections.pop("gateways", GatewaysSection(identity=server.directory)),
        **sections,
    )
    clock = Clock(START + 3600 * SECOND)
    with Store(place or settings.store.place, clock=clock) as store:
        cloud = make_cloud(settings, store, clock=clock, dashboard=folder / "dashboard")
        cloud.feed.ids = cloud.feed.encoder.ids = PlainIds(bytes(32))
        cloud.feed.frame_encoder.ids = cloud.feed.ids
        token = create_token(store, scopes=[Scope.READ], name="test", lifetime=timedelta(hours=1))
        admit(store, NODE)
        yield Stand(cloud, clock, identities.gateway, token)


def problem(response: httpx.Response, status: int) -> str:
    """Check that an answer is problem details; gives what they say."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    body = json.loads(response.content)
    assert body["status"] == status
    assert set(body) == {"type", "title", "status", "detail", "instance"}
    assert body["detail"]
    assert "Traceback" not in response.text
    return str(body["detail"])


def count_frames(stand: Stand) -> int:
    """How many frames are stored as they came."""
    with stand.cloud.store.read() as connection:
        return connection.execute(select(func.count()).select_from(frames)).scalar_one()
