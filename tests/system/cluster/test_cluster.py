"""A store on a coordinator and workers: distributed, checked, written while shards move."""

from __future__ import annotations

import os
import re
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import chain, count, islice
from threading import Event
from typing import TYPE_CHECKING, Any

import psycopg
import pytest
from eskin_cloud.store import Store
from eskin_cloud.store.distribute import check, distribute
from eskin_cloud.store.location import reading_engine, writing_engine
from eskin_cloud.store.move import TABLES, move
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.tables import audit_log, feed, sequences
from eskin_cloud.store.shard_groups import read_groups, shard_places_now
from eskin_cloud.store.version import create_tables
from eskin_cloud.store.write.audit_log import Action, AuditEntry, record
from eskin_cloud.store.write.parsed_message import ParsedMessage
from sqlalchemy import Engine, event, func, select, update
from sqlalchemy.exc import DBAPIError

from eskin.errors import QueryError, StoreError
from eskin.wire.slot import SLOTS, slot_of
from tests.support.citus import CitusCluster
from tests.support.commands import run
from tests.support.processes import wait_until
from tests.support.stores import ask_store, write_place
from tests.unit.cloud.clouds import put, put_items
from tests.unit.cloud.commits import kinds
from tests.unit.cloud.messages import START, stretch

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_cloud.store.write.write_cache import WriteCache
    from sqlalchemy import URL, Connection, Table

pytestmark = pytest.mark.cluster

BY_ITSELF = "SELECT create_distributed_table('pages', 'slot', colocate_with => 'none')"


def command(place: URL, *words: str) -> Any:
    """Run ``eskin cloud distribute``."""
    return run("cloud", "distribute", "--url", str(write_place(place)["url"]), *words)


def rows(place: URL | Path, table: Table) -> list[dict[str, Any]]:
    """All rows of a table."""
    with Store(place) as store, store.read() as connection:
        return [dict(row) for row in connection.execute(select(table)).mappings()]


def distributed(place: URL) -> list[str]:
    """The tables that Citus knows."""
    found = ask_store(place, "SELECT logicalrelid::text FROM pg_dist_partition")
    return sorted(name for (name,) in found)


def send(store: Store, nodes: list[str], number: int) -> int:
    """Store a frame of each node twice in one batch, which is sent again until it is stored.

    Gives how often it was refused.
    """
    refused = 0
    items = [ParsedMessage.parse(node, stretch(number).encode()) for node in nodes]
    while True:
        try:
            receipts = kinds(put_items(store, [*items, *items]))
        except StoreError:
            refused += 1
            time.sleep(0.1)  # as a gateway waits
        else:
            assert set(receipts[len(items) :]) == {"duplicate"}
            return refused


def of_slots(slot: int) -> Iterator[str]:
    """The nodes of a slot."""
    return (name for k in count() if slot_of(name := f"node-{k}") == slot)


def of_slot(slot: int) -> str:
    """A node of a slot."""
    return next(of_slots(slot))


def test_command_distributes_an_empty_store_once(servers: CitusCluster) -> None:
    place = servers.fresh(empty=True)
    unready = command(place, "--check")
    assert unready.returncode == 2
    assert "schema version" in unready.stderr or "does not exist" in unready.stderr
    done = command(place)
    assert done.returncode == 0, done.stderr
    checked = command(place, "--check")
    assert checked.returncode == 0, checked.stderr
    for said in (done.stdout, checked.stdout):
        *lines, _ = said.splitlines()
        found = [re.fullmatch(r" *(\d+) slots in +(\d+) shards  (.+)", line) for line in lines]
        assert sum(int(each[1]) for each in found if each) == SLOTS
        assert [each[3] for each in found if each] == [
            servers.name_of(worker) for worker in servers.workers
        ]
    before = distributed(place)
    again = command(place)
    assert (again.returncode, again.stdout) == (2, "")
    assert "distributed already" in again.stderr
    assert distributed(place) == before
    with Store(place) as store:
        assert kinds(put(store, stretch(0), stretch(1), stretch(0))) == [
            "stored", "stored", "duplicate",
        ]  # fmt: skip
    assert len(rows(place, frames)) == 2


def test_store_with_data_is_refused_and_loses_nothing(servers: CitusCluster) -> None:
    place = servers.fresh(empty=True)
    with Store(place) as store:
        put(store, stretch(0), stretch(1))
    before = {table.name: rows(place, table) for table in TABLES}
    refused = command(place)
    assert refused.returncode == 2
    assert "not empty" in refused.stderr
    assert distributed(place) == []
    assert {table.name: rows(place, table) for table in TABLES} == before
    with Store(place) as store:
        assert kinds(put(store, stretch(1), stretch(2))) == ["duplicate", "stored"]


def test_store_moves_from_sqlite_into_a_distributed_one(
    servers: CitusCluster, tmp_path: Path
) -> None:
    source, target = tmp_path / "store.sqlite", servers.fresh()
    with Store(source) as store:
        for slot in range(0, SLOTS, 3):
            put(store, stretch(0), stretch(1), node=of_slot(slot))
        store.write_and_wait(lambda c: record(c, AuditEntry("ada", "", Action.SIGN_IN), now=START))
    counts = move(source, target, now=START)
    assert counts["frames"] == 44
    check(target)
    with Store(target) as store:
        assert kinds(put(store, stretch(1), stretch(2), node=of_slot(3))) == ["duplicate", "stored"]


@pytest.mark.parametrize("at", [1, 12, 20, -1])
def test_distribution_that_is_killed_leaves_nothing_half_done(
    servers: CitusCluster, at: int
) -> None:
    place = servers.fresh(empty=True)
    child = os.fork()
    if child == 0:
        steps = count(1)

        def kill(*arguments: Any) -> None:
            if str(arguments[2]).startswith("SELECT create_") and next(steps) == at:
                os.kill(os.getpid(), signal.SIGKILL)

        def end(*_: Any) -> None:
            os.kill(os.getpid(), signal.SIGKILL)

        event.listen(Engine, "before_cursor_execute", kill)
        if at < 0:
            event.listen(Engine, "commit", end)
        distribute(place, now=START)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status), "it was killed, not done"
    assert distributed(place) == []
    assert command(place).returncode == 0
    check(place)


def test_distribution_survives_the_loss_of_a_worker(servers: CitusCluster) -> None:
    place = servers.fresh(empty=True)
    servers.workers[1].running.kill()
    try:
        refused = command(place)
    finally:
        servers.workers[1].start()
    assert refused.returncode == 2
    assert servers.name_of(servers.workers[1]) in refused.stderr
    assert distributed(place) == []
    distribute(place, now=START)
    check(place)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("SELECT undistribute_table('frames')", "table frames is local"),
        ("SELECT undistribute_table('tokens')", "table tokens is local, not a reference table"),
        (
            "SELECT undistribute_table('pages'); " + BY_ITSELF,
            "table pages is distributed in another way",
        ),
        ("DELETE FROM feed WHERE slot = 7", "feed lacks rows of the slots"),
    ],
)
def test_check_finds_what_is_not_distributed_as_it_should_be(
    servers: CitusCluster, change: str, said: str
) -> None:
    place = servers.fresh()
    check(place)
    servers.execute(change, database=str(place.database))
    found = command(place, "--check")
    assert found.returncode == 2
    assert said in found.stderr


def test_check_finds_a_worker_that_is_down_or_not_durable(servers: CitusCluster) -> None:
    place, worker = servers.fresh(), servers.workers[0]
    try:
        worker.execute("ALTER SYSTEM SET synchronous_commit = off", database="postgres")
        worker.execute("SELECT pg_reload_conf()", database="postgres")
        with pytest.raises(StoreError, match=f"{worker.port} has synchronous_commit = off"):
            check(place)
        worker.running.kill()
        with pytest.raises(StoreError, match=str(worker.port)):
            check(place)
    finally:
        if worker.running.process is None or worker.running.process.poll() is not None:
            worker.start()
        worker.execute("ALTER SYSTEM RESET synchronous_commit", database="postgres")
        worker.execute("SELECT pg_reload_conf()", database="postgres")
    check(place)


def test_worker_is_refused_in_the_place_of_the_coordinator(servers: CitusCluster) -> None:
    place, worker = servers.fresh(), servers.workers[0]
    with pytest.raises(StoreError, match="is a worker; name the coordinator"):
        distribute(worker.place(str(place.database)), now=START)


def test_cluster_without_a_worker_is_refused(programs: Path) -> None:
    with CitusCluster(programs, workers=0) as alone:
        place = alone.fresh(empty=True)
        with pytest.raises(StoreError, match="citus_add_node"):
            distribute(place, now=START)
        assert distributed(place) == []


def test_slots_of_a_shard_are_locked_together_and_those_of_two_are_refused(
    servers: CitusCluster,
) -> None:
    """What `read_groups` is for: this is the rule of Citus that it follows."""
    place = servers.fresh()
    engine = writing_engine(place)
    with engine.begin() as connection:
        groups = read_groups(connection)
    assert sorted(slot for group in groups for slot in group) == list(range(SLOTS))
    assert len(groups) > 2 * len(servers.workers)

    def lock(slots: set[int]) -> int:
        with engine.begin() as connection:
            query = select(feed.c.slot).where(feed.c.slot.in_(sorted(slots))).with_for_update()
            return len(connection.execute(query).all())

    for group in groups:
        assert lock(set(group)) == len(group)
    with pytest.raises(DBAPIError, match="FOR UPDATE"):
        lock({min(groups[0]), min(groups[1])})
    engine.dispose()


def test_audit_log_stays_append_only(servers: CitusCluster) -> None:
    with Store(servers.fresh()) as store:
        store.write_and_wait(lambda c: record(c, AuditEntry("ada", "", Action.SIGN_IN), now=START))
        with pytest.raises(DBAPIError, match="append only"):
            store.write_and_wait(lambda c: c.execute(update(audit_log).values(actor="eve")))


def bring(store: Store, nodes: list[str], ended: Event) -> int:
    """Store messages of nodes as a gateway sends them; gives how many batches were refused."""
    refused = 0
    for number in count():
        refused += send(store, nodes, number)
        if ended.is_set():
            return refused
    raise AssertionError


@contextmanager
def flowing(place: URL, slots: range) -> Iterator[tuple[list[Store], list[int]]]:
    """Two clouds store messages in all slots meanwhile; at the end each is there once.

    Gives the clouds' stores, and at the end how many batches of each were refused.
    """
    ended, refused = Event(), list[int]()
    nodes = [[each for slot in slots for each in islice(of_slots(slot), n, n + 1)] for n in (0, 1)]
    with Store(place) as one, Store(place) as other, ThreadPoolExecutor(2) as pool:
        stores = [one, other]
        flows = [pool.submit(bring, *each, ended) for each in zip(stores, nodes, strict=True)]
        try:
            yield stores, refused
        finally:
            ended.set()
        refused += [flow.result(120) for flow in flows]
    kept = rows(place, frames)
    by_node: dict[str, list[int]] = {node: [] for node in chain(*nodes)}
    for row in kept:
        by_node[row["node"]].append(row["sequence"])
    lasts = [{max(by_node[node]) for node in mine} for mine in nodes]
    assert all(sorted(each) == list(range(max(each) + 1)) for each in by_node.values())
    assert all(len(last) == 1 for last in lasts), "each batch was stored as a whole"
    ranges = {row["node"]: (row["first"], row["last"]) for row in rows(place, sequences)}
    assert ranges == {node: (0, max(each)) for node, each in by_node.items()}
    assert len({row["cursor"] for row in kept}) == len(kept)


def test_worker_added_while_data_flow_loses_and_doubles_nothing(programs: Path) -> None:
    """Two clouds store; a third worker takes shards meanwhile. A failed batch is sent again."""
    with CitusCluster(programs) as cluster:
        place = cluster.fresh()
        with flowing(place, range(0, SLOTS, 2)):
            added = cluster.start_worker(place)
            rebalance = "SELECT rebalance_table_shards(shard_transfer_mode => 'force_logical')"
            cluster.execute(rebalance, database=str(place.database))
        by_server = {each.name: each for each in check(place)}
        assert by_server[cluster.name_of(added)].slots, "it has taken shards"


def largest_shards(place: URL) -> list[tuple[int, list[int]]]:
    """The number of each shard and its slots by their hashes, those of most slots first."""
    found: dict[int, list[int]] = {}
    asked = (
        "SELECT get_shard_id_for_distribution_column('feed', slot), slot"
        " FROM feed ORDER BY hashint4(slot)"
    )
    for shard, slot in ask_store(place, asked):
        found.setdefault(shard, []).append(slot)
    return sorted(found.items(), key=lambda each: -len(each[1]))


def split(servers: CitusCluster, place: URL, shard: int, *, after: int) -> None:
    """Split a shard after a slot, in the order of hashes: a part goes to each worker."""
    hashed = f"(SELECT hashint4({after})::text)"
    nodes = "(SELECT array_agg(nodeid) FROM pg_dist_node WHERE shouldhaveshards)"
    servers.execute(
        f"SELECT citus_split_shard_by_split_points({shard}, ARRAY[{hashed}], {nodes},"
        " 'block_writes')",
        database=str(place.database),
    )


def move_shard(servers: CitusCluster, place: URL, shard: int) -> None:
    """Move a shard to the other worker."""
    ports = dict(map(tuple, ask_store(place, "SELECT shardid, nodeport FROM citus_shards")))
    source = ports[shard]
    (target,) = (each.port for each in servers.workers if each.port != source)
    host = servers.folder
    servers.execute(
        f"SELECT citus_move_shard_placement({shard}, '{host}', {source}, '{host}', {target},"
        " 'force_logical')",
        database=str(place.database),
    )


def logging_statements(servers: CitusCluster, place: URL) -> list[int]:
    """Have workers log all statements of new sessions; gives how long their logs are."""
    for worker in servers.workers:
        words = f"ALTER DATABASE {place.database} SET log_statement = 'all'"
        worker.execute(words, database="postgres")
    return [len(worker.running.output()) for worker in servers.workers]


def test_shards_that_are_split_and_moved_while_data_flow_lose_and_double_nothing(
    servers: CitusCluster,
) -> None:
    """A transaction over two parts of a shard is refused once; then the cloud knows them."""
    place = servers.fresh()
    logging_statements(servers, place)
    (first, slots), (second, others), (third, _), *_ = largest_shards(place)
    with flowing(place, range(SLOTS)) as (clouds, refused):
        for store in clouds:
            assert len(store.shares(slots + others, of_slot)) == 2
            wait_until(lambda: store.commits > SLOTS, "the cloud stores")  # noqa: B023
        move_shard(servers, place, third)
        split(servers, place, first, after=slots[0])
        split(servers, place, second, after=others[0])
        for store in clouds:
            wait_until(
                lambda: len(store.shares(slots + others, of_slot)) == 4,  # noqa: B023
                "the cloud has read the shards anew",
            )
        lengths = [len(worker.running.output()) for worker in servers.workers]
        for store in clouds:
            done = store.commits
            wait_until(lambda: store.commits > done + 2 * SLOTS, "it goes on")  # noqa: B023
        logs = [worker.running.output() for worker in servers.workers]
    assert all(refused), "each cloud wrote what was split"
    check(place)
    for log, length in zip(logs, lengths, strict=True):
        assert "FOR UPDATE" in log[length:]
        assert "PREPARE TRANSACTION" not in log[length:], "a transaction was of two servers"


def test_transaction_of_a_node_stays_in_one_shard(servers: CitusCluster) -> None:
    """A transaction of two servers is prepared at each (two-phase commit)."""
    place = servers.fresh()
    before = logging_statements(servers, place)
    with Store(place) as store:
        for slot in range(0, SLOTS, 5):
            put(store, stretch(0), stretch(1), node=of_slot(slot))
    for worker, length in zip(servers.workers, before, strict=True):
        said = worker.running.output()[length:]
        assert "FOR UPDATE" in said
        assert "PREPARE TRANSACTION" not in said


def test_shard_of_a_locked_slot_stays_where_it_is(servers: CitusCluster) -> None:
    """Where it moved meanwhile, another cloud would lock the slot at the new server."""
    place, slot = servers.fresh(), 7
    database = str(place.database)
    source = next(each for each in check(place) if slot in each.slots)
    here = next(each for each in servers.workers if servers.name_of(each) == source.name)
    there = next(each for each in servers.workers if each is not here)
    move = (
        "SELECT citus_move_shard_placement(get_shard_id_for_distribution_column('feed', "
        f"{slot}), '{servers.folder}', {here.port}, '{servers.folder}', {there.port}, "
        "'force_logical')"
    )
    begun = (
        b"SELECT count(*) FROM pg_replication_slots"
        b" WHERE slot_name LIKE 'citus_shard_move_slot%' AND confirmed_flush_lsn IS NOT NULL"
    )
    ended = Event()

    def hold(_: Connection, cache: WriteCache) -> str:
        """Have the slot locked once the shard is being copied, for longer than a move takes."""
        assert not ended.wait(15), "the shard has moved while the slot is locked"
        return cache.name

    with Store(place) as store, ThreadPoolExecutor(1) as pool:
        put(store, stretch(0), node=of_slot(slot))  # the writer knows by now what is distributed
        moving = pool.submit(servers.execute, move, database=database)
        moving.add_done_callback(lambda _: ended.set())
        with psycopg.connect(here.words(database), autocommit=True) as worker:
            wait_until(lambda: worker.execute(begun).fetchall() != [(0,)], "the shard is copied")
        assert store.write_slots([slot], hold).result(60) == store.name
        moving.result(60)
    assert slot in next(e for e in check(place) if e.name == servers.name_of(there)).slots


def test_reading_transaction_in_which_a_shard_moved_is_refused(servers: CitusCluster) -> None:
    """At the new server it has a state from before the rows came, as if they were never stored."""
    place = servers.fresh()
    (shard, slots), *_ = largest_shards(place)
    ports = dict(map(tuple, ask_store(place, "SELECT shardid, nodeport FROM citus_shards")))
    others = next(slots for other, slots in largest_shards(place) if ports[other] != ports[shard])
    moved, stays = of_slot(slots[0]), of_slot(others[0])

    def stored(connection: Connection, node: str) -> int:
        query = select(func.count()).where(of_node(frames, node))
        return connection.execute(query).scalar_one()

    def ask(store: Store, *, fails: bool) -> None:
        with store.read() as connection:
            assert stored(connection, stays) == 1
            move_shard(servers, place, shard)
            assert stored(connection, moved) == 0, "Citus has one state of all servers by now"
            if fails:
                raise QueryError(moved, "is not known")

    with Store(place) as store:
        for node in (moved, stays):
            put(store, stretch(0), node=node)
        for fails in (False, True):
            with pytest.raises(StoreError, match="moved"):
                ask(store, fails=fails)
            with store.read() as connection:
                assert [stored(connection, node) for node in (moved, stays)] == [1, 1]


def test_shard_that_moved_there_and_back_has_moved(servers: CitusCluster) -> None:
    place = servers.fresh()
    (shard, _), *_ = largest_shards(place)
    reading = reading_engine(place, readers=1)
    before = [shard_places_now(reading) for _ in range(2)]
    assert before[0] == before[1] is not None
    for _ in range(2):
        move_shard(servers, place, shard)
    assert shard_places_now(reading) != before[0]
    reading.dispose()


def test_store_whose_shard_moves_while_it_is_copied_is_not_taken_for_whole(
    servers: CitusCluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Copy and source would be the same, as both are read in one transaction."""
    source, lacking, target = (servers.fresh() for _ in range(3))
    (shard, _), *_ = largest_shards(source)
    with Store(source) as store:
        for slot in range(SLOTS):
            put(store, stretch(0), node=of_slot(slot))

    def create_after_a_move(connection: Connection, *, now: int) -> bytes:
        move_shard(servers, source, shard)
        return create_tables(connection, now=now)

    with monkeypatch.context() as patched:
        patched.setattr("eskin_cloud.store.move.create_tables", create_after_a_move)
        with pytest.raises(StoreError, match="may lack its rows"):
            move(source, lacking, now=START)
    assert move(source, target, now=START)["frames"] == SLOTS
    assert len(rows(target, frames)) == SLOTS
