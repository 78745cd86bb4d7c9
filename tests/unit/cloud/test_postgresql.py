"""PostgreSQL: start, faults, several processes."""

from __future__ import annotations

import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.settings import StoreSection
from eskin_cloud.store import Store, version
from eskin_cloud.store.feed_entry import FEED_START, last_position
from eskin_cloud.store.schema.frame_tables import frames, pages
from eskin_cloud.store.schema.tables import (
    audit_log,
    nodes,
    sequences,
    versions,
)
from eskin_cloud.store.write.audit_log import Action, AuditEntry, check_audit_entries, record
from sqlalchemy import delete, func, select, text, update

from eskin.errors import QueryError, StoreError
from eskin.identity.identity import ROOT_FILE
from tests.unit.cloud.clouds import numbers, problem, put, standing
from tests.unit.cloud.messages import NODE, START, stretch

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import URL, Connection

    from tests.support.identities import Identities
    from tests.support.postgresql import Cluster


@pytest.fixture
def store(cluster: Cluster, shared_database: URL) -> Iterator[Store]:
    """An empty store."""
    cluster.clear(shared_database)
    with Store(shared_database) as opened:
        yield opened


def test_durability_is_asked_of_the_server(store: Store) -> None:
    def asked(connection: Connection) -> list[object]:
        names = ("fsync", "synchronous_commit", "full_page_writes")
        return [connection.execute(text(f"SHOW {name}")).scalar_one() for name in names]

    assert store.write(asked).result(120) == ["on"] * 3


def test_concurrent_starts_create_the_tables_once(cluster: Cluster) -> None:
    place = cluster.fresh(empty=True)
    with ThreadPoolExecutor(4) as pool:
        for store in pool.map(lambda _: Store(place), range(4)):
            store.close()
    with Store(place) as store, store.read() as connection:
        applied = connection.execute(select(versions.c.version).order_by(versions.c.version))
        assert list(applied.scalars()) == [version.VERSION]
        assert last_position(connection) == FEED_START


def test_store_of_another_version_is_not_written(store: Store) -> None:
    later = version.VERSION + 1
    store.write(lambda c: c.execute(versions.insert().values(version=later, applied=0))).result(120)
    try:
        with pytest.raises(StoreError, match="schema version"):
            put(store, stretch(0))
        with pytest.raises(StoreError, match="schema version"):
            store.check()
    finally:
        store._writing.dispose()
        with store._writing.begin() as connection:
            connection.execute(delete(versions).where(versions.c.version == later))


def test_two_processes_store_each_message_once(store: Store) -> None:
    with Store(store.location) as other:
        for number in range(6):
            first, second = (store, other) if number % 2 else (other, store)
            assert [r.result for r in put(first, stretch(number)).results] == ["stored"]
            assert [r.result for r in put(second, stretch(number)).results] == ["duplicate"]
        with ThreadPoolExecutor(2) as pool:
            many = [stretch(number) for number in range(6, 60)]
            outcomes = list(pool.map(lambda to: put(to, *many), (store, other)))
    stored = [receipt.result for outcome in outcomes for receipt in outcome.results]
    assert stored.count("stored") == 54
    with store.read() as connection:
        cursors = list(connection.execute(select(frames.c.cursor)).scalars())
        assert numbers(sorted(cursors)) == list(range(1, 61))
        assert connection.execute(select(pages.c.frames)).scalar_one() == 60
        assert connection.execute(select(sequences.c.first, sequences.c.last)).all() == [(0, 59)]


def test_next_server_is_tried_where_the_first_is_away(cluster: Cluster, store: Store) -> None:
    place = store.location
    assert not isinstance(place, Path)
    away = f"{cluster.folder}/away:{cluster.port}"
    place = place.set(query={"host": (away, f"{cluster.folder}:{cluster.port}")}, port=None)
    with Store(place) as other, other.read() as connection:
        assert connection.execute(select(func.count()).select_from(versions)).scalar_one() == 1


@pytest.mark.parametrize("fault", [None, QueryError("node", "is not known")])
def test_reading_while_a_shard_moves_is_refused_whatever_the_reader_makes_of_it(
    store: Store, monkeypatch: pytest.MonkeyPatch, fault: Exception | None
) -> None:
    """Only where shards are is made up here; `tests/system/cluster` moves one on Citus."""
    places = ["1@1"]
    for name in ("shard_places", "shard_places_now"):
        monkeypatch.setattr(f"eskin_cloud.store.store.{name}", lambda _: places[0])

    def read(cloud: Store, *, moves: bool = False) -> None:
        with cloud.read() as connection:
            assert last_position(connection) == FEED_START
            if moves:
                places[0] = "1@2"
                if fault is not None:
                    raise fault

    with Store(store.location) as cloud:
        read(cloud)
        with pytest.raises(StoreError):
            read(cloud, moves=True)
        read(cloud)


def test_unit_of_another_process_counts(store: Store) -> None:
    put(store, stretch(0))
    with Store(store.location) as other:
        assert put(other, stretch(1, unit="H")).results[0].result == "rejected"
        put(other, stretch(2, channel="t09.inductance", unit="H"))
    assert put(store, stretch(3, channel="t09.inductance")).results[0].result == "rejected"
    assert put(store, stretch(4)).results[0].result == "stored"
    with store.read() as connection:
        assert connection.execute(select(nodes.c.sequence)).scalar_one() == 4


@pytest.mark.nightly
def test_unreachable_server_is_reported_and_retries_store_once(
    cluster: Cluster, store: Store
) -> None:
    put(store, stretch(0))
    cluster.stop()
    try:
        with pytest.raises(StoreError, match=r"cannot be written: .*then retry"):
            put(store, stretch(1))
        with pytest.raises(StoreError, match="does not answer; start it"):
            put(store, stretch(1))
        with pytest.raises(StoreError, match="cannot be read"):
            store.check()
    finally:
        cluster.start()
    assert [r.result for r in put(store, stretch(0), stretch(1)).results] == ["duplicate", "stored"]
    store.check()


@pytest.mark.nightly
def test_killed_server_keeps_acknowledged_messages(cluster: Cluster, store: Store) -> None:
    put(store, stretch(0))
    cluster.running.kill()
    try:
        with pytest.raises(StoreError, match=r"cannot be written: .*then retry"):
            put(store, stretch(1))
    finally:
        cluster.start()
    assert [r.result for r in put(store, stretch(0), stretch(1)).results] == ["duplicate", "stored"]


def test_writes_wait_for_a_server_that_hangs(cluster: Cluster, store: Store) -> None:
    put(store, stretch(0))
    cluster.running.signal(signal.SIGSTOP)
    with ThreadPoolExecutor(1) as pool:
        try:
            waiting = pool.submit(put, store, stretch(1))
            with pytest.raises(TimeoutError):
                waiting.result(1.0)
        finally:
            cluster.running.signal(signal.SIGCONT)
        assert [receipt.result for receipt in waiting.result(120).results] == ["stored"]


@pytest.mark.parametrize(
    ("code", "remedy"),
    [("53100", "free space"), ("57014", "too slow"), ("53300", "raise max_connections")],
)
def test_fault_states_a_remedy(store: Store, code: str, remedy: str) -> None:
    refusal = f"BEGIN RAISE EXCEPTION 'no' USING ERRCODE = '{code}'; END"
    make = f"CREATE FUNCTION refuse() RETURNS trigger LANGUAGE plpgsql AS $$ {refusal} $$"
    when = "CREATE TRIGGER refuse BEFORE INSERT ON frames EXECUTE FUNCTION refuse()"
    store.write(lambda c: [c.execute(text(words)) for words in (make, when)]).result(120)
    try:
        with pytest.raises(StoreError, match=remedy):
            put(store, stretch(0))
    finally:
        store.write(lambda c: c.execute(text("DROP FUNCTION refuse CASCADE"))).result(120)
    assert put(store, stretch(0)).results[0].result == "stored"


@pytest.mark.anyio
async def test_fault_is_a_problem_with_a_remedy(
    cluster: Cluster, tmp_path: Path, identities: Identities
) -> None:
    place = cluster.fresh()
    with standing(tmp_path, identities, place=place) as stand:
        cluster.shut(place)
        said = problem(await stand.get("/api/v1/nodes"), 503)
        assert "correct store.url" in said


def test_audit_log_is_append_only(store: Store) -> None:
    audit_entry = AuditEntry("another\0", "::1", Action.SIGN_IN)
    store.write(lambda c: record(c, audit_entry, now=START)).result(120)
    for change in (update(audit_log).values(actor="me"), delete(audit_log)):
        with pytest.raises(Exception, match="append only"):
            store.write(lambda c, change=change: c.execute(change)).result(120)  # type: ignore[misc]
    with store.read() as connection:
        assert check_audit_entries(connection) is None
        assert connection.execute(select(func.count()).select_from(audit_log)).scalar_one() == 1


def test_nul_in_a_name_is_no_name(store: Store) -> None:
    with store.read() as connection:
        query = select(nodes.c.node).where(nodes.c.node == f"{NODE}\0")
        assert connection.execute(query).all() == []


def test_server_is_reached_by_tls_and_password(
    cluster: Cluster, tmp_path: Path, identities: Identities
) -> None:
    place = cluster.fresh()
    cluster.execute("CREATE ROLE remote LOGIN SUPERUSER PASSWORD 'word'", database="postgres")
    root = identities.gateway.directory / ROOT_FILE
    (tmp_path / "word").write_text("word\n")
    (tmp_path / "other").write_text("guess")
    url = f"postgresql://remote@localhost:{cluster.port}/{place.database}"
    section = StoreSection(url=url, password_file=tmp_path / "word", root=root)
    with Store(section.place) as store, store.read() as connection:
        words = "SELECT ssl FROM pg_stat_ssl WHERE pid = pg_backend_pid()"
        assert connection.execute(text(words)).scalar_one() is True
        # It notices within 20 s that a cloud is gone, of whose end it is not notified.
        names = ("tcp_keepalives_idle", "tcp_keepalives_interval", "tcp_keepalives_count")
        shown = [connection.execute(text(f"SHOW {name}")).scalar_one() for name in names]
        assert shown == ["5", "5", "3"]
    for changed, said in (
        ({"root": tmp_path / "word"}, "root certificate|SSL"),
        ({"password_file": tmp_path / "other"}, "the password is wrong; see store.password_file"),
        ({"url": url.replace("localhost", "127.0.0.2")}, "does not answer"),
        ({"url": url.replace("store_", "lost_")}, "create it with createdb"),
    ):
        wrong = section.model_copy(update=changed)
        with pytest.raises(StoreError, match=said):
            Store(wrong.place)
