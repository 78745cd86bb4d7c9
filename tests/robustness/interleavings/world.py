"""The world of a schedule: clouds on one database, and what is stored at its beginning.

Two nodes have slots of one group. Some frames are compacted and in tiles, one of them came late, so
that its chunk of tiles is stale; further ones wait for compaction. A sealed message of a person
is stored. `World.restore` brings all of it back: tables are emptied and filled from a copy in
another schema, which takes less time than a database made from a template.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import psycopg
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.service import make_cloud
from eskin_cloud.settings import CloudSettings, GatewaysSection, StoreSection
from eskin_cloud.store import Store
from eskin_cloud.store.compaction import Due, compact_frames, find_compactable_frames
from eskin_cloud.store.descriptions import read_description, store_descriptions
from eskin_cloud.store.schema.tables import metadata, versions
from eskin_cloud.store.write.ingest import IngestResult, ingest, ingest_individually
from eskin_cloud.store.write.node_sites import store_sites
from eskin_cloud.store.write.parsed_message import ParsedMessage
from sqlalchemy import delete, update

from eskin.identity import IdentityKind
from eskin.privacy import Encryptor, FileMasterKey, KeyStore
from eskin.wire.frames import EncodedFrame
from eskin.wire.slot import even_groups, slot_of
from tests.support.identities import SITE, Identities
from tests.support.postgresql import Cluster
from tests.unit.cloud.messages import START, skin_of, stretch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from eskin_cloud.app_state import AppState
    from eskin_cloud.store.location import StoreLocation
    from eskin_cloud.store.write.write_cache import WriteCache
    from sqlalchemy import URL, Connection

    from eskin.wire.frames import Frame, Layout, Patch

GATEWAY: Final = "gateway.g1"
MOST_UNITS: Final = 3
OPEN: Final = "t01.capacitance"
SEALED: Final = "t05.bioelectric"
ALL: Final = Due(2**62, 2**62)
"""Frames of any age and number."""
SPACING: Final = 3000
"""Between two frames, ns: some fill a chunk of tiles."""
_COPY: Final = "initial"


def _node_of(slot: int) -> str:
    return next(name for k in count() if slot_of(name := f"node-{k}") == slot)


NEAR: Final = _node_of(3)
FAR: Final = _node_of(5)
"""A node of another slot, which the same transaction may write."""
SLOTS_USED: Final = (slot_of(NEAR), slot_of(FAR))
assert len({even_groups(4)[slot] for slot in SLOTS_USED}) == 1


@dataclass(frozen=True, slots=True)
class Message:
    """A message of a node, as a gateway brings it.

    Attributes:
        node: The node.
        sequence: Its number, of boot 1.
        data: Its bytes.
        frame: What it holds; ``None`` if it is sealed.
    """

    node: str
    sequence: int
    data: bytes
    frame: Frame | None

    @property
    def place(self) -> tuple[str, int]:
        """Node and number."""
        return self.node, self.sequence


def say(node: str, sequence: int, *, at: int | None = None, seed: int = 0) -> Message:
    """A frame of some samples."""
    first = START + SPACING * (sequence if at is None else at)
    lo = np.random.default_rng([seed, sequence]).integers(-40, 40, 5) / 8.0  # as tiles hold them
    frame = stretch(sequence, lo, lo + 0.5, time=(first, first), dt=1, channel=OPEN)
    return Message(node, sequence, frame.encode(), frame)


class World:
    """Clouds, databases and messages; its databases and logins stay in the cluster.

    Args:
        cluster: Where the databases are.
        identities: For the clouds' settings.
        folder: Of its own.

    Attributes:
        erased: The person who is erased, by pseudonym.
        batches: What the first, second and third cloud that ingests is brought.
        stored: What is stored at the beginning.
        later: What each cloud is brought after a schedule.
        source: A store with the same, for moves.
    """

    def __init__(self, cluster: Cluster, identities: Identities, folder: Path) -> None:
        server = identities.make(IdentityKind.SERVER, "server.interleavings")
        self._settings = CloudSettings(
            store=StoreSection(path=folder / "unused.sqlite"),
            gateways=GatewaysSection(identity=server.directory),
        )
        self._clouds: dict[tuple[str, str], AppState] = {}
        self._restoring: dict[str, str] = {}
        self._sql: dict[str, psycopg.Connection] = {}
        keys = KeyStore(folder / "site", FileMasterKey(folder / "site.key"))
        person = keys.create("Ada Lovelace")
        self.erased = person.pseudonym
        encryptor = Encryptor()

        def seal(node: str, sequence: int) -> Message:
            first = START + SPACING * sequence
            said = stretch(sequence, time=(first, first), channel=SEALED, unit="V")
            data = said.encode()
            sealed = encryptor.encrypt(person, node, EncodedFrame.decode(data), data)
            return Message(node, sequence, sealed.encode(), None)

        self._early = [say(NEAR, k) for k in (0, 1, 3, 4)]
        late = [say(NEAR, 2)]
        waiting = [say(NEAR, 5), say(NEAR, 6, at=2), say(FAR, 0), seal(FAR, 7)]
        self._late, self._waiting = late, waiting
        self.stored = [*self._early, *late, *waiting]
        twice, apart = say(NEAR, 20), say(FAR, 20)
        # A sealed message in a slot that is not erased in, unless it comes.
        self.batches = [
            [twice, seal(NEAR, 21), say(NEAR, 22, at=2, seed=1)],
            [apart, say(NEAR, 22, at=2, seed=2), twice, say(NEAR, 23, at=2)],
            [twice, say(FAR, 24)],
        ]
        self.later = [say(NEAR, 100 + k, at=8 + k) for k in range(MOST_UNITS)]
        self.roles = {f"unit_{k}": k for k in range(MOST_UNITS)}
        roles = "".join(f"CREATE ROLE {role} SUPERUSER LOGIN; " for role in self.roles)
        cluster.execute(roles, database="postgres")
        self.main, self.target = cluster.fresh(), cluster.fresh()
        self.source: StoreLocation = folder / "source.sqlite"
        for place in (self.source, self.main):
            with Store(place, clock=self.clock) as store:
                self._fill(store)
        # A cloud refuses a store whose key a move has changed, and clouds here outlive a move.
        with Store(self.source) as source, Store(self.target) as target:
            same_key = update(versions).values(cursor_key=target.cursor_key)
            source.write_and_wait(lambda connection: connection.execute(same_key))
        for place in (self.main, self.target):
            self._keep(place)

    def close(self) -> None:
        """Close all clouds."""
        for cloud in self._clouds.values():
            cloud.store.close()
        for connection in self._sql.values():
            connection.close()

    @staticmethod
    def clock() -> int:
        """UTC ns; the time stands."""
        return START + 3600 * 10**9

    def cloud(self, number: int | None, place: URL) -> AppState:
        """The cloud of a unit; that of no unit, which never stops, without a number."""
        role = place.username if number is None else f"unit_{number}"
        key = str(role), str(place.database)
        if key not in self._clouds:
            store = Store(place.set(username=role), readers=1, clock=self.clock)
            self._clouds[key] = make_cloud(self._settings, store, clock=self.clock)
        return self._clouds[key]

    def ask(self, place: URL, query: str) -> Sequence[tuple[Any, ...]]:
        """Rows that are committed, by plain SQL."""
        return self._connect(place).execute(query.encode()).fetchall()

    def restore(self, place: URL) -> None:
        """Bring back what is stored at the beginning; no unit may run."""
        self._connect(place).execute(self._restoring[str(place.database)].encode())

    def blocked(self, place: URL) -> dict[str, set[str]]:
        """The logins that wait for a lock, and those who hold it."""
        found = self._connect(place).execute(_BLOCKED).fetchall()
        waiting: dict[str, set[str]] = {}
        for role, holder in found:
            waiting.setdefault(role, set()).add(holder)
        return waiting

    def _connect(self, place: URL) -> psycopg.Connection:
        name = str(place.database)
        if name not in self._sql:
            host = str(place.query["host"])
            words = {"host": host, "dbname": name, "user": str(place.username)}
            if place.port:
                words["port"] = str(place.port)
            self._sql[name] = psycopg.connect(**words, autocommit=True)  # type: ignore[arg-type]  # a word each
        return self._sql[name]

    def _keep(self, place: URL) -> None:
        """Copy all tables; what is to be emptied is append only for others than a replica."""
        connection = self._connect(place)
        connection.execute(f"CREATE SCHEMA {_COPY}".encode())
        words = []
        for table in metadata.sorted_tables:
            if table is versions:
                continue
            name = f"{_COPY}.{table.name}"
            copy = f"CREATE TABLE {name} AS SELECT * FROM {table.name}"  # noqa: S608 - ours
            made = connection.execute(copy.encode())
            words.append(str(delete(table)))
            if made.rowcount:
                words.append(f"INSERT INTO {table.name} SELECT * FROM {name}")  # noqa: S608 - ours
        connection.execute(b"SET session_replication_role = replica; SET synchronous_commit = off")
        self._restoring[str(place.database)] = "BEGIN; " + "; ".join(words) + "; COMMIT"

    def _fill(self, store: Store) -> None:
        def describe(connection: Connection, _: WriteCache) -> None:
            introduce(connection, [NEAR, FAR], now=store.clock())

        store.write_slots(SLOTS_USED, describe).result(60)
        for batch in (self._early, self._late, self._waiting):
            found = bring(store, batch)
            assert all(each.result == "stored" for each in found.results), found
            if batch is not self._waiting:
                compact_all(store)
            if batch is self._early:
                build(store)


@contextmanager
def opened(folder: Path) -> Iterator[World]:
    """A world on a server of its own."""
    identities = Identities(folder / "identities")
    with Cluster() as cluster:
        # Nothing here cuts the power; a commit then waits for no disk.
        cluster.execute("ALTER SYSTEM SET fsync = off", database="postgres")
        cluster.execute("SELECT pg_reload_conf()", database="postgres")
        world = World(cluster, identities, folder)
        try:
            yield world
        finally:
            world.close()


_BLOCKED: Final = b"""
    SELECT waiting.usename, holding.usename
    FROM pg_stat_activity AS waiting
    CROSS JOIN LATERAL unnest(pg_blocking_pids(waiting.pid)) AS blocking (pid)
    JOIN pg_stat_activity AS holding ON holding.pid = blocking.pid
    WHERE waiting.datname = current_database() AND waiting.wait_event_type = 'Lock'
"""


def introduce(connection: Connection, nodes: Sequence[str], *, now: int) -> None:
    """Store of what site nodes are, and their descriptions, as if they had been presented."""
    store_sites(connection, [(node, b"") for node in nodes], site=SITE, gateway=GATEWAY, now=now)
    said: list[Layout | Patch] = [*skin_of(OPEN, "F"), *skin_of(SEALED, "V")]
    described = [read_description(each.encode()) for each in said]
    for node in nodes:
        store_descriptions(connection, node, described)


def bring(store: Store, messages: Sequence[Message], *, introduced: bool = True) -> IngestResult:
    """Store a batch in one transaction, as `eskin_cloud.api.ingest` does.

    Args:
        store: The cloud's.
        messages: The batch, of slots of one group.
        introduced: Whether the nodes are known; else the transaction introduces them.
    """
    items = [ParsedMessage.parse(each.node, each.data) for each in messages]

    def work(
        take: Callable[..., IngestResult], connection: Connection, cache: WriteCache
    ) -> IngestResult:
        now = store.clock()
        if not introduced:
            introduce(connection, sorted({each.node for each in messages}), now=now)
        return take(
            *(connection, cache, items), gateway=GATEWAY, site=SITE, now=now, dead_letters=100
        )

    slots = {slot_of(each.node) for each in messages}
    ways = partial(work, ingest), partial(work, ingest_individually)
    return store.write_slots(slots, ways[0], fallback=ways[1], shared=True).result(60)


def compact_all(store: Store) -> None:
    """Compact all frames, as `eskin_cloud.jobs.compaction` does; the server's order may vary."""
    for page in sorted(find_compactable_frames(store, ALL)):
        while compact_frames(store, page, ALL):
            pass
