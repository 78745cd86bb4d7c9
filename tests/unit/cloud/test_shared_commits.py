"""Batches that share a commit: the cache is saved once, failures are isolated."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest
from eskin_cloud.store import Store
from eskin_cloud.store.feed_entry import last_position
from eskin_cloud.store.schema.frame_tables import descriptions, frames, pages
from eskin_cloud.store.schema.tables import (
    dead_letters,
    events,
    nodes,
    sequences,
)
from eskin_cloud.store.write.bulk_insert import bulk_insert
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import Engine, event, func, select
from sqlalchemy.exc import IntegrityError

from eskin.errors import QueryError
from tests.support.examples import examples
from tests.unit.cloud.clouds import emptied, put
from tests.unit.cloud.commits import bring, kinds, one_commit
from tests.unit.cloud.messages import NODE, gap, peak, status, stretch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from eskin_cloud.store.write.write_cache import WriteCache
    from sqlalchemy import Connection, Table

    from tests.unit.cloud.clouds import Clock, Said

_COMPARED: Final = (dead_letters, descriptions, events, frames, nodes, pages, sequences)


def contents(store: Store) -> dict[str, list[tuple[Any, ...]]]:
    """All that batches leave in a store."""
    with store.read() as connection:
        found = {
            table.name: [tuple(row) for row in connection.execute(_sorted(table)).all()]
            for table in _COMPARED
        }
        found["feed"] = [last_position(connection).cursors]
    return found


def _sorted(table: Table) -> Any:
    return select(table).order_by(*table.primary_key.columns)


def _count(connection: Connection, table: Table) -> int:
    return connection.execute(select(func.count()).select_from(table)).scalar_one()


def refuse(_: Connection) -> None:
    """Refuse a batch after it was taken, as a token that was used before does."""
    raise QueryError("token", "used before")


def stumble(_: Connection) -> None:
    """Raise an unexpected error."""
    raise ZeroDivisionError


def collide(connection: Connection) -> None:
    """Add a row that is there already: PostgreSQL reports it when the COPY ends."""
    row = connection.execute(select(frames).limit(1)).one()
    inserts_ = bulk_insert(connection, frames)
    inserts_.add(tuple(row))
    inserts_.finish()


def test_shared_commit_saves_the_cache_once(store: Store) -> None:
    saved: list[str] = []

    def note(_: Connection, __: Any, statement: str, *rest: object) -> None:
        del rest
        saved.append(" ".join(statement.split()[:2]))

    put(store, stretch(0), status(1))
    event.listen(Engine, "before_cursor_execute", note)
    with one_commit(store):
        written = [bring(store, stretch(10 * k), stretch(10 * k + 1)) for k in range(1, 9)]
    assert [kinds(each.result(120)) for each in written] == [["stored"] * 2] * 8
    event.remove(Engine, "before_cursor_execute", note)
    assert saved.count("UPDATE pages") == saved.count("UPDATE nodes") == 1
    assert saved.count("UPDATE feed") == 1
    store.clear_caches()
    assert kinds(put(store, stretch(80), stretch(82))) == ["duplicate", "stored"]


def test_other_work_sees_earlier_batches(store: Store) -> None:
    def count(connection: Connection, _: WriteCache) -> tuple[int, int]:
        rows = select(func.count()).select_from(frames)
        counted = select(func.coalesce(func.sum(pages.c.frames), 0))
        return connection.execute(rows).scalar_one(), connection.execute(counted).scalar_one()

    with one_commit(store):
        bring(store, stretch(0), stretch(1))
        first = store.write_node(NODE, count)
        bring(store, stretch(2))
        second = store.write_node(NODE, count)
    assert first.result(120) == (2, 2)
    assert second.result(120) == (3, 3)


@pytest.mark.parametrize(("then", "stated"), [
    (refuse, QueryError), (stumble, ZeroDivisionError), (collide, IntegrityError),
])  # fmt: skip
def test_failed_batch_affects_no_other(
    store: Store,
    caplog: pytest.LogCaptureFixture,
    then: Callable[[Connection], None],
    stated: type[Exception],
) -> None:
    put(store, stretch(0))
    with one_commit(store):
        before = bring(store, stretch(1), peak(2))
        broken = bring(store, stretch(3), then=then)
        after = bring(store, stretch(4))
        other = store.write_node(
            NODE, lambda c, _: c.execute(select(func.count()).select_from(frames)).scalar()
        )
    with pytest.raises(stated):
        broken.result(120)
    assert kinds(before.result(120)) == ["stored", "stored"]
    assert kinds(after.result(120)) == ["stored"]
    assert other.result(120) == 3
    assert kinds(put(store, stretch(1), stretch(3), stretch(4))) == [
        "duplicate",
        "stored",
        "duplicate",
    ]
    assert "commit failed" not in caplog.text
    with store.read() as connection:
        assert connection.execute(select(dead_letters)).all() == []


def test_message_that_fails_becomes_a_dead_letter_alone(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("eskin_cloud.store.write.ingest.statement_rows", breaks)
    with one_commit(store):
        written = [
            bring(store, stretch(0)),
            bring(store, stretch(1), peak(2)),
            bring(store, stretch(3)),
        ]
    assert [kinds(each.result(120)) for each in written] == [
        ["stored"], ["stored", "rejected"], ["stored"],
    ]  # fmt: skip


_WORK: Final = st.tuples(
    st.lists(st.integers(0, 12), max_size=4),
    st.sampled_from([None, None, None, refuse, stumble, collide]),
    st.booleans(),
)


@settings(max_examples=examples(25), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(_WORK, max_size=8))
def test_shared_commits_equal_single_commits(
    twins: tuple[Store, Store], work: list[tuple[list[int], Any, bool]]
) -> None:
    shared, alone = map(emptied, twins)
    for store in (shared, alone):
        put(store, stretch(99))
    with one_commit(shared):
        written = []
        for numbers, then, between in work:
            written.append(bring(shared, *map(_said, numbers), then=then))
            if between:
                shared.write_node(
                    NODE, lambda c, _: c.execute(select(func.count()).select_from(nodes)).scalar()
                )
    stated = [_outcome(each) for each in written]
    apart = [
        _outcome(bring(alone, *map(_said, numbers), then=then, shared=False))
        for numbers, then, _ in work
    ]
    assert stated == apart
    assert contents(shared) == contents(alone)


def _said(number: int) -> Said:
    kinds = (peak, gap, status, partial(stretch, unit="H"))  # the last is refused: another unit
    return (
        kinds[number % 4](number)
        if number % 3 == 0
        else stretch(number, channel=f"t{number % 4}.c")
    )


def _outcome(future: Any) -> object:
    error = future.exception(120)
    return kinds(future.result()) if error is None else type(error)


@pytest.fixture
def twins(
    place: Any, clock: Clock, request: pytest.FixtureRequest
) -> Iterator[tuple[Store, Store]]:
    """Two empty stores of a kind."""
    other = (
        place.with_name("twin.sqlite")
        if isinstance(place, Path)
        else request.getfixturevalue("cluster").fresh()
    )
    with Store(place, clock=clock) as one, Store(other, clock=clock) as two:
        yield one, two
