"""The store as a whole: one writer, shared commits, its version, faults."""

from __future__ import annotations

from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.store import Store, version
from eskin_cloud.store.schema.frame_tables import frames, pages
from eskin_cloud.store.schema.tables import dead_letters, feed, nodes, versions
from eskin_cloud.store.write.ingest import ingest, ingest_individually
from eskin_cloud.store.write.pages import add_frames
from eskin_cloud.store.write.parsed_message import ParsedMessage
from eskin_cloud.store.write.write_cache import WriteCache
from sqlalchemy import func, insert, select, text

from eskin.errors import StoreError
from eskin.wire.slot import SLOTS, slot_of
from tests.unit.cloud.clouds import present, put, put_items
from tests.unit.cloud.commits import one_commit
from tests.unit.cloud.messages import NODE, START, status, stretch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from sqlalchemy import Connection, Table

    from eskin.wire.frames import Frame


def rows(store: Store, table: Table) -> list[dict[str, Any]]:
    """All rows of a table."""
    with store.read() as connection:
        return [dict(row) for row in connection.execute(select(table)).mappings()]


def results(outcome: Any) -> list[str]:
    """What became of each item."""
    return [result.result for result in outcome.results]


SLOT = [slot_of(NODE)]


@pytest.fixture
def file_store(tmp_path: Path) -> Iterator[Store]:
    """One that is an SQLite file."""
    with Store(tmp_path / "store.sqlite") as opened:
        yield opened


def test_failed_job_is_rolled_back_alone(store: Store) -> None:
    def fails(connection: Connection, cache: WriteCache) -> None:
        items = [ParsedMessage.parse(NODE, stretch(0).encode())]
        present(connection, cache, items)
        ingest(connection, cache, items, gateway="g", now=START, dead_letters=9)
        raise ValueError("after its work")

    failed, good = (
        store.write_node(NODE, fails),
        store.write_node(NODE, lambda c, _: c.execute(select(func.max(feed.c.cursor))).all()),
    )
    with pytest.raises(ValueError, match="after its work"):
        failed.result(120)
    assert good.result(120) == [(SLOTS - 1,)]
    assert rows(store, frames) == []
    assert results(put(store, stretch(0))) == ["stored"]
    assert rows(store, pages)[0]["frames"] == 1


def noise(sequence: int) -> Frame:
    """A frame that is not small."""
    lo = np.random.default_rng(sequence).random(900)
    return stretch(sequence, lo, lo + 1.0)


def test_full_disk_acknowledges_nothing(file_store: Store) -> None:
    store = file_store
    put(store, stretch(0))
    pages = store.write(lambda c: c.execute(text("PRAGMA page_count")).scalar_one()).result(120)
    store.write(lambda c: c.execute(text(f"PRAGMA max_page_count={pages}")).all()).result(120)
    with pytest.raises(StoreError, match="full"):
        put(store, *map(noise, range(1, 40)))
    assert "full" in str(store.fault)
    store.write(lambda c: c.execute(text("PRAGMA max_page_count=1000000")).all()).result(120)
    store.check()
    assert not store.fault
    again = put(store, *map(noise, range(1, 40)))
    assert results(again) == ["stored"] * 39
    assert len(rows(store, frames)) == 40


@pytest.mark.parametrize("shortage", [MemoryError(), OSError(5, "Input/output error")])
def test_shortage_rejects_no_message(
    store: Store, monkeypatch: pytest.MonkeyPatch, shortage: Exception
) -> None:
    fails = iter([True])

    def short(*args: Any) -> None:
        if next(fails, False):
            raise shortage
        add_frames(*args)

    def work(take: Callable[..., Any], connection: Connection, cache: WriteCache) -> Any:
        items = [ParsedMessage.parse(NODE, stretch(n).encode()) for n in range(3)]
        present(connection, cache, items)
        return take(connection, cache, items, gateway="g", now=START, dead_letters=9)

    monkeypatch.setattr("eskin_cloud.store.write.ingest.add_frames", short)
    ways = partial(work, ingest), partial(work, ingest_individually)
    with pytest.raises(StoreError, match=r"out of memory|Input/output"):
        store.write_slots(SLOT, ways[0], fallback=ways[1]).result(120)
    assert rows(store, frames) == []
    assert results(store.write_slots(SLOT, ways[0], fallback=ways[1]).result(120)) == ["stored"] * 3
    assert store.fault is None


def test_shortage_in_the_fallback_rejects_no_message(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    faults = iter([ValueError("not foreseen"), MemoryError()])

    def short(*_: Any) -> None:
        raise next(faults)

    def work(take: Callable[..., Any], connection: Connection, cache: WriteCache) -> Any:
        items = [ParsedMessage.parse(NODE, stretch(0).encode())]
        present(connection, cache, items)
        return take(connection, cache, items, gateway="g", now=START, dead_letters=9)

    monkeypatch.setattr("eskin_cloud.store.write.ingest.add_frames", short)
    ways = partial(work, ingest), partial(work, ingest_individually)
    with pytest.raises(StoreError, match="out of memory"):
        store.write_slots(SLOT, ways[0], fallback=ways[1]).result(120)
    assert rows(store, dead_letters) == []


def test_unexpected_error_does_not_stop_the_writer(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = iter([MemoryError(), RuntimeError("unforeseen")])
    lock = WriteCache.lock

    def breaks(*arguments: Any) -> None:
        fault = next(broken, None)
        if fault is not None:
            raise fault
        lock(*arguments)

    monkeypatch.setattr(WriteCache, "lock", breaks)
    for stated in ("out of memory", "unforeseen"):
        with pytest.raises(StoreError, match=stated):
            put(store, stretch(0))
    assert results(put(store, stretch(0))) == ["stored"]


def test_waiting_jobs_share_a_commit(store: Store) -> None:
    with one_commit(store):
        before = store.commits
        cursor = select(func.min(feed.c.cursor))
        more = [
            store.write_node(NODE, lambda c, _: c.execute(cursor).scalar_one()) for _ in range(9)
        ]
    assert [future.result(120) for future in more] == [0] * 9
    store.close()
    assert store.commits == before + 2


def test_full_queue_refuses(tmp_path: Path) -> None:
    held: Future[None] = Future()
    started: Future[None] = Future()

    def wait(_: Connection) -> None:
        started.set_result(None)
        held.result(120)

    with Store(tmp_path / "s.sqlite", queue=2) as store:
        store.write(wait)
        started.result(120)
        store.write(lambda _: None)
        store.write(lambda _: None)
        with pytest.raises(StoreError, match="2 writes wait"):
            store.write(lambda _: None)
        held.set_result(None)
    with pytest.raises(StoreError, match="closed"):
        store.write(lambda _: None)


def test_cancelled_work_is_left_out(store: Store) -> None:
    held: Future[None] = Future()
    started: Future[None] = Future()

    def wait(_: Connection) -> None:
        started.set_result(None)
        held.result(120)

    store.write(wait)
    started.result(120)
    given_up = store.write(lambda c: c.execute(insert(versions).values(version=9, applied=0)))
    assert given_up.cancel()
    held.set_result(None)
    put(store, stretch(0))
    applied = [row["version"] for row in rows(store, versions)]
    assert applied == [version.VERSION]


def test_batch_of_nodes_with_and_without_a_status_is_stored(store: Store) -> None:
    stated, silent = status(0).encode(), stretch(0).encode()
    put_items(store, [ParsedMessage.parse("stated", stated), ParsedMessage.parse("silent", silent)])
    assert {row["node"]: row["profile"] for row in rows(store, nodes)} == {
        "stated": "fingertip",
        "silent": None,
    }


def test_schema_of_another_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    with Store(path) as store:
        store.write(
            lambda c: c.execute(insert(versions).values(version=version.VERSION + 1, applied=0))
        ).result(120)
        with pytest.raises(StoreError, match="schema version"):
            store.check()
    with pytest.raises(StoreError, match="schema version"):
        Store(path)


def test_file_that_is_no_store_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    path.write_bytes(b"no database, " * 700)
    with pytest.raises(StoreError, match="cannot be opened"):
        Store(path)


def test_durability_is_asked_of_sqlite(file_store: Store) -> None:
    def pragmas(connection: Connection) -> tuple[object, object]:
        return (
            connection.execute(text("PRAGMA journal_mode")).scalar_one(),
            connection.execute(text("PRAGMA synchronous")).scalar_one(),
        )

    assert file_store.write(pragmas).result(120) == ("wal", 2)
