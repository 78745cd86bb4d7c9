"""Distribute a store over the servers of a Citus cluster, and check one that is.

A table whose primary key begins with the slot is distributed by it: all rows of a slot are on one
server. Each other table is copied to every server (Citus: a reference table), but for those with
triggers, which Citus does not distribute; they stay on the coordinator.
"""

from __future__ import annotations

import json
import re
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

from sqlalchemy import func, select, text
from sqlalchemy.exc import SQLAlchemyError

from eskin.errors import StoreError
from eskin.wire.slot import SLOTS
from eskin_cloud.store.db_errors import explain
from eskin_cloud.store.location import describe, writing_engine
from eskin_cloud.store.schema.alarm_tables import alarm_state
from eskin_cloud.store.schema.tables import audit_log, feed, metadata, versions
from eskin_cloud.store.shard_groups import read_groups
from eskin_cloud.store.version import create_tables, require_version

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import URL, Connection, Engine, Table

POSTGRESQL: Final = 15
"""The major version of PostgreSQL that is tested with Citus."""
CITUS: Final = "13.0"
"""The version of Citus that is tested."""
SHARDS: Final = 32
"""Of each distributed table; a shard has the slots whose hashes are in its range."""
AT_COORDINATOR: Final = (audit_log,)
"""Tables with triggers, which keep them append-only."""

_NEVER_EMPTY: Final = (versions, feed, alarm_state)
_DURABLE: Final = ("fsync", "synchronous_commit", "full_page_writes")
"""Settings that must be on: at a worker its own count, not those of the cloud's session."""
_FACTS: Final = """
SELECT json_build_object(
  'postgresql', current_setting('server_version_num')::int,
  'citus', citus_version(),
  'fsync', current_setting('fsync'),
  'synchronous_commit', current_setting('synchronous_commit'),
  'full_page_writes', current_setting('full_page_writes')
)
"""
_ON_ALL: Final = text(
    "SELECT nodename || ':' || nodeport AS server, success, result"
    " FROM run_command_on_all_nodes(:command) JOIN pg_dist_node USING (nodeid)"
    " ORDER BY groupid"
)
_HAS_CITUS: Final = text("SELECT EXISTS (SELECT FROM pg_extension WHERE extname = 'citus')")
_VERSION: Final = text("SELECT current_setting('server_version_num')::int")
_NODES: Final = text(
    "SELECT (SELECT groupid FROM pg_dist_local_group) AS here,"
    " count(*) FILTER (WHERE groupid = 0) AS coordinators,"
    " count(*) FILTER (WHERE groupid <> 0 AND shouldhaveshards) AS workers,"
    " string_agg(nodename || ':' || nodeport, ', ') FILTER (WHERE NOT isactive) AS inactive"
    " FROM pg_dist_node WHERE noderole = 'primary'"
)
_KINDS: Final = text(
    "SELECT logicalrelid::text AS name, partmethod::text AS method, repmodel::text AS model,"
    " column_to_column_name(logicalrelid, partkey) AS by, colocationid AS together"
    " FROM pg_dist_partition"
)
_PLACES: Final = text(
    "SELECT n.nodename || ':' || n.nodeport AS server, s.slot, s.shard"
    " FROM pg_dist_node n LEFT JOIN pg_dist_placement p USING (groupid)"
    " JOIN (SELECT slot, get_shard_id_for_distribution_column('feed', slot) AS shard"
    "  FROM generate_series(0, :last) AS slot) s ON s.shard = p.shardid"
    " WHERE n.noderole = 'primary' ORDER BY n.groupid, s.slot"
)


class TableKind(NamedTuple):
    """How a table is distributed.

    Attributes:
        method: Citus's letters: ``h`` by a hash, ``n`` not; with ``t`` it is a reference table.
        by: The column of the hash.
        with_feed: Whether its shards are where those of ``feed`` are.
    """

    method: str
    by: str | None
    with_feed: bool


_BY_SLOT: Final = TableKind("hs", "slot", with_feed=True)
_REFERENCE: Final = TableKind("nt", None, with_feed=False)


@dataclass(frozen=True, slots=True)
class ClusterServer:
    """A server that has rows of nodes.

    Attributes:
        name: Host and port, as the coordinator knows it.
        slots: The slots whose rows it has.
        shards: In how many shards of a table they are.
    """

    name: str
    slots: frozenset[int]
    shards: int


def is_of_slot(table: Table) -> bool:
    """Whether a table is distributed by slot: its primary key begins with it."""
    return next(iter(table.primary_key.columns)).name == "slot"


def distribution() -> list[str]:
    """The statements that distribute all tables, for one transaction."""
    tables = [each for each in metadata.sorted_tables if each not in AT_COORDINATOR]
    return [
        # The tables of one transaction are made by one connection to each server.
        "SET LOCAL citus.multi_shard_modify_mode = 'sequential'",
        f"SET LOCAL citus.shard_count = {SHARDS}",
        *(
            f"SELECT create_reference_table('{each.name}')"
            for each in tables
            if not is_of_slot(each)
        ),
        f"SELECT create_distributed_table('{feed.name}', 'slot', colocate_with => 'none')",
        *(
            f"SELECT create_distributed_table('{each.name}', 'slot', "
            f"colocate_with => '{feed.name}')"
            for each in tables
            if is_of_slot(each) and each is not feed
        ),
        # Citus leaves the rows that a table had where no statement reads them.
        *(
            f"SELECT truncate_local_data_after_distributing_table('{each.name}')"
            for each in _NEVER_EMPTY
        ),
    ]


def require_versions(postgresql: int, citus: str | None, *, server: str) -> None:
    """Refuse versions of PostgreSQL and Citus that are not tested together.

    Args:
        postgresql: ``server_version_num``.
        citus: What ``citus_version()`` returns; ``None`` where there is no extension.
        server: The server's name.

    Raises:
        StoreError: A version is another one.
    """
    major = postgresql // 10_000
    if major != POSTGRESQL:
        raise StoreError(
            f"{server}: PostgreSQL {major} is not tested with Citus; use PostgreSQL {POSTGRESQL}"
        )
    if citus is None:
        raise StoreError(
            f"{server}: the database has no extension citus; at each server, write citus into "
            "shared_preload_libraries, start the server again, and run CREATE EXTENSION citus"
        )
    found = re.match(r"Citus (\d+\.\d+)", citus)
    if found is None or found[1] != CITUS:
        raise StoreError(
            f"{server}: {citus.partition(' on ')[0]} is not tested; build Citus {CITUS} "
            "by services/citus/build.sh"
        )


def distribute(url: URL, *, now: int) -> list[ClusterServer]:
    """Distribute an empty store, in one transaction; make its tables where there are none.

    Args:
        url: The coordinator's database; the extension is in it, and the workers are added.
        now: UTC ns.

    Returns:
        The servers with their slots.

    Raises:
        StoreError: There is no such Citus, the store has data or is distributed, or a server
            refuses. Then nothing has changed.
    """
    with _coordinator(url) as engine, engine.begin() as connection:
        # What makes hundreds of tables may take longer than what a cloud writes.
        connection.execute(text("SET LOCAL statement_timeout = 0"))
        _require_cluster(connection, url)
        create_tables(connection, now=now)
        found = _kinds(connection)
        if found == _expected_kinds():
            raise StoreError(
                f"{describe(url)}: the store is distributed already; "
                "`eskin cloud distribute --check` checks it"
            )
        if found:
            raise StoreError(
                f"{describe(url)}: another program has distributed {', '.join(sorted(found))}; "
                "name an empty database"
            )
        _require_empty(connection, url)
        for statement in distribution():
            connection.execute(text(statement))
        return _servers(connection)


def check(url: URL) -> list[ClusterServer]:
    """Check a running cluster: its servers, their versions and settings, and all tables.

    It then locks the slots of each shard once, as a writer does.

    Args:
        url: The coordinator's database.

    Returns:
        The servers with their slots.

    Raises:
        StoreError: Something is not as `distribute` makes it; all of it is named.
    """
    with _coordinator(url) as engine:
        with engine.begin() as connection:
            _require_cluster(connection, url)
            require_version(connection)
            wrong = [*_wrong_settings(connection), *_wrong_tables(connection)]
            if wrong:
                raise StoreError(f"{describe(url)}: {'; '.join(wrong)}")
            groups, servers = read_groups(connection), _servers(connection)
        for slots in groups:
            with engine.begin() as connection:
                query = select(feed.c.slot).where(feed.c.slot.in_(sorted(slots)))
                if set(connection.scalars(query.with_for_update())) != slots:
                    raise StoreError(
                        f"{describe(url)}: feed lacks rows of the slots {sorted(slots)}; "
                        "restore a backup"
                    )
        return servers


@contextmanager
def _coordinator(url: URL) -> Iterator[Engine]:
    """An engine whose transactions hold the lock of central rows.

    Raises:
        StoreError: A statement failed.
    """
    engine = writing_engine(url)
    try:
        yield engine
    except SQLAlchemyError as error:
        raise StoreError(f"{describe(url)}: {explain(error)}") from error
    finally:
        engine.dispose()


def _require_cluster(connection: Connection, url: URL) -> None:
    """Refuse a server that is no coordinator, and a cluster with another version.

    Raises:
        StoreError: It cannot be used, or a server of it does not answer.
    """
    name = describe(url)
    has_citus = bool(connection.scalar(_HAS_CITUS))
    citus = connection.scalar(text("SELECT citus_version()")) if has_citus else None
    require_versions(connection.execute(_VERSION).scalar_one(), citus, server=name)
    nodes = connection.execute(_NODES).one()
    if nodes.here != 0:
        raise StoreError(f"{name}: this server is a worker; name the coordinator")
    if not nodes.coordinators or not nodes.workers:
        raise StoreError(
            f"{name}: the cluster has no worker, or does not know its coordinator; run "
            "SELECT citus_set_coordinator_host(HOST, PORT), then SELECT citus_add_node(HOST, PORT) "
            "for each worker"
        )
    if nodes.inactive:
        raise StoreError(
            f"{name}: not active: {nodes.inactive}; run SELECT citus_activate_node(HOST, PORT)"
        )
    for server, facts in _ask_all(connection):
        require_versions(int(facts["postgresql"]), facts["citus"], server=server)


def _ask_all(connection: Connection) -> Iterator[tuple[str, dict[str, str]]]:
    """Versions and settings of each server.

    Raises:
        StoreError: One does not answer.
    """
    for row in connection.execute(_ON_ALL, {"command": _FACTS}):
        if not row.success:
            raise StoreError(f"{row.server}: {row.result}; start this server, or remove it")
        yield row.server, json.loads(row.result)


def _wrong_settings(connection: Connection) -> Iterator[str]:
    for server, facts in _ask_all(connection):
        for name in _DURABLE:
            if facts[name] != "on":
                yield f"{server} has {name} = {facts[name]}, and must have it on"


def _wrong_tables(connection: Connection) -> Iterator[str]:
    found, expected = _kinds(connection), _expected_kinds()
    for name in sorted({*found, *expected}):
        if found.get(name) != expected.get(name):
            yield f"table {name} is {_named(found.get(name))}, not {_named(expected.get(name))}"


def _named(kind: TableKind | None) -> str:
    names = {_BY_SLOT: "distributed by slot", _REFERENCE: "a reference table", None: "local"}
    return names.get(kind, "distributed in another way")


def _kinds(connection: Connection) -> dict[str, TableKind]:
    """How each of the store's tables is distributed; without those that are local."""
    rows = {row.name: row for row in connection.execute(_KINDS) if row.name in metadata.tables}
    ours = rows[feed.name].together if feed.name in rows else None
    return {
        name: TableKind(row.method + row.model, row.by, with_feed=row.together == ours)
        for name, row in rows.items()
    }


def _expected_kinds() -> dict[str, TableKind]:
    return {
        each.name: _BY_SLOT if is_of_slot(each) else _REFERENCE
        for each in metadata.sorted_tables
        if each not in AT_COORDINATOR
    }


def _require_empty(connection: Connection, url: URL) -> None:
    """Refuse a store with data, and keep others from writing until the commit.

    Raises:
        StoreError: A table has rows.
    """
    names = ", ".join(metadata.tables)
    connection.execute(text(f"LOCK TABLE {names} IN SHARE ROW EXCLUSIVE MODE"))
    for table in metadata.sorted_tables:
        if table in _NEVER_EMPTY:
            continue
        if connection.execute(select(func.count()).select_from(table)).scalar_one():
            raise StoreError(
                f"{describe(url)}: not empty: it has rows of {table.name}; name an empty database. "
                "This one stays as it is"
            )


def _servers(connection: Connection) -> list[ClusterServer]:
    slots: dict[str, set[int]] = {}
    shards: dict[str, set[int]] = {}
    for server, slot, shard in connection.execute(_PLACES, {"last": SLOTS - 1}):
        slots.setdefault(server, set()).add(slot)
        shards.setdefault(server, set()).add(shard)
    return [
        ClusterServer(server, frozenset(own), len(shards[server])) for server, own in slots.items()
    ]
