"""Moving a store from SQLite to PostgreSQL: all of it, also after a power cut half way."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

import pytest
from sqlalchemy import func, select, text

from cloud.store import Store
from cloud.store.move import TABLES, move
from cloud.store.schema import blocks
from eskin.errors import StoreError
from tests.cloud.clouds import put
from tests.cloud.messages import START, block, gap, peak, status

if TYPE_CHECKING:
    from pathlib import Path

    from sqlalchemy import URL

    from tests.postgresql import Cluster

_BLOCKS = 1203


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A store with something in most tables."""
    path = tmp_path / "store.sqlite"
    with Store(path) as store:
        put(store, status(0), peak(1), gap(2))
        put(store, *(block(number, [-float("inf")], [0.1]) for number in range(3, 3 + _BLOCKS)))
        put(store, block(9999, unit="H"))
    return path


def count(place: Path | URL) -> int:
    with Store(place) as store, store.read() as connection:
        return connection.execute(select(func.count()).select_from(blocks)).scalar_one()


def rows(place: Path | URL) -> dict[str, list[tuple[object, ...]]]:
    with Store(place) as store, store.read() as connection:
        return {
            table.name: [
                tuple(row)
                for row in connection.execute(select(table).order_by(*table.primary_key.columns))
            ]
            for table in TABLES
        }


def killed_at_step(source: Path, target: URL, step: int) -> None:
    """Move in a process that a power cut ends."""

    def die(done: int, _: int) -> None:
        if done >= step:
            os.kill(os.getpid(), signal.SIGKILL)

    child = os.fork()
    if child == 0:
        move(source, target, now=START, progress=die)
        os._exit(1)
    _, ended = os.waitpid(child, 0)
    assert os.WTERMSIG(ended) == signal.SIGKILL


def test_killed_move_goes_on_and_everything_arrives(source: Path, cluster: Cluster) -> None:
    target = cluster.fresh(empty=True)
    killed_at_step(source, target, 600)
    assert 0 < count(target) < _BLOCKS
    with Store(target) as store, pytest.raises(StoreError, match="is being moved here"):
        put(store, block(0))
    killed_at_step(source, target, 2000)  # while it compares
    assert count(target) == _BLOCKS
    told: list[tuple[int, int]] = []
    counts = move(source, target, now=START, progress=lambda *step: told.append(step))
    assert counts["blocks"] == _BLOCKS
    assert told[-1][0] == told[-1][1]
    assert rows(target) == rows(source)
    with Store(target) as store:
        outcome = put(store, block(3), block(2000))
        assert [receipt.result for receipt in outcome.results] == ["duplicate", "stored"]
        assert outcome.entries[0].cursor == _BLOCKS + 4


def test_what_differs_is_noticed(source: Path, cluster: Cluster) -> None:
    target = cluster.fresh(empty=True)
    killed_at_step(source, target, 2000)
    change = text("UPDATE blocks SET hi = 9 WHERE sequence = 700")
    cluster.execute(str(change), database=str(target.database))
    with pytest.raises(StoreError, match="blocks: what arrived differs"):
        move(source, target, now=START)
    with Store(target) as store, pytest.raises(StoreError, match="is being moved here"):
        put(store, block(0))


def test_store_in_use_is_no_target(source: Path, cluster: Cluster) -> None:
    target = cluster.fresh()
    with Store(target) as store:
        put(store, block(0))
    with pytest.raises(StoreError, match="no empty store: it has"):
        move(source, target, now=START)
