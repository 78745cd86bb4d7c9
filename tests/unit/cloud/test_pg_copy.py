"""PostgreSQL's COPY: rows are sent at once, and a failure stores nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from psycopg.pq import TransactionStatus
from sqlalchemy import text

from eskin.errors import StoreError
from tests.unit.cloud.clouds import put
from tests.unit.cloud.commits import bring, kinds, one_commit
from tests.unit.cloud.messages import stretch

if TYPE_CHECKING:
    from eskin_cloud.store import Store
    from sqlalchemy import Connection

pytestmark = pytest.mark.parametrize("place", ["postgresql"], indirect=True)


def test_connection_lost_during_copy_stores_nothing(store: Store) -> None:
    put(store, stretch(0))

    def cut(_: Connection) -> None:
        with store._reading.begin() as other:
            own = text(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                "WHERE datname = current_database() AND query LIKE 'COPY frames%'"
            )
            assert other.execute(own).all() == [(True,)]

    broken = bring(store, stretch(1), then=cut)
    with pytest.raises(StoreError, match="then retry"):
        broken.result(120)
    assert kinds(put(store, stretch(0), stretch(1))) == ["duplicate", "stored"]


@pytest.mark.parametrize("fault", [MemoryError(), OSError(5, "Input/output error")])
def test_shortage_during_copy_stores_nothing(store: Store, fault: Exception) -> None:
    def short(_: Connection) -> None:
        raise fault

    with one_commit(store):
        broken = [bring(store, stretch(0)), bring(store, stretch(1), then=short)]
    for each in broken:
        with pytest.raises(StoreError, match=r"out of memory|Input/output"):
            each.result(120)
    assert kinds(put(store, stretch(0), stretch(1))) == ["stored"] * 2


@pytest.mark.parametrize("fault", [KeyError("of a type"), MemoryError()])
def test_failed_copy_leaves_the_connection_usable(
    store: Store, monkeypatch: pytest.MonkeyPatch, fault: Exception
) -> None:
    def breaks(*_: object) -> None:
        raise fault

    with monkeypatch.context() as patch:
        patch.setattr("psycopg.Copy.set_types", breaks)
        stated = bring(store, stretch(0))
        if stated.exception(120) is None:
            assert kinds(stated.result()) == ["rejected"]
    assert kinds(put(store, stretch(0))) == ["stored"]


def test_copy_sends_rows_as_they_arrive(store: Store) -> None:
    under_way: list[bool] = []
    put(store, stretch(0))

    def look(connection: Connection) -> None:
        driver: Any = connection.connection.driver_connection
        under_way.append(driver.pgconn.transaction_status == TransactionStatus.ACTIVE)

    bring(store, stretch(1), then=look).result(120)
    assert under_way == [True]
