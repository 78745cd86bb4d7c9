"""A window of any length reads at most a thousand rows."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from eskin_cloud.query.series import read_series
from eskin_cloud.rollup.patch_tile_builder import build
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.schema.frame_tables import patch_rows
from sqlalchemy import Connection, create_engine, select, text

from eskin.monitor import parse
from tests.unit.cloud.brute_force import compact_all, verdicts_of
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from eskin_cloud.store import Store
    from eskin_cloud.store.read.lookup import Channel

SAMPLES: Final = 100
PERIOD: Final = 100_000_000
"""So that a frame is as long as the shortest compacted row."""
LENGTH: Final = SAMPLES * PERIOD
FEW: Final = 1000
SETTLED: Final = parse("x > 9")
"""Of a state that no sample is in: bounds state it."""
_TOUCHED: Final = text(
    "SELECT sum(pg_stat_get_xact_tuples_returned(oid)) FROM pg_class "
    "WHERE relnamespace = 'public'::regnamespace"
)


class Rows:
    """Counts the rows that a transaction gets from a file, or that it touches on a server.

    The server counts what it reads from tables and indexes for sums, too; a file counts only what
    it hands over.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._fetched = 0
        self.file: Any = connection.connection.driver_connection
        self._is_file = connection.dialect.name == "sqlite"

    def __enter__(self) -> Callable[[], int]:
        if not self._is_file:
            before = self._touched()
            return lambda: self._touched() - before
        self.file.row_factory = self._count
        return lambda: self._fetched

    def __exit__(self, *_: object) -> None:
        if self._is_file:
            self.file.row_factory = None

    def _count(self, _: object, row: tuple[Any, ...]) -> tuple[Any, ...]:
        self._fetched += 1
        return row

    def _touched(self) -> int:
        return int(self._connection.execute(_TOUCHED).scalar_one())


@contextmanager
def asked(store: Store) -> Iterator[tuple[Connection, Channel, Callable[[], int]]]:
    with store.read() as connection, Rows(connection) as count:
        yield connection, find_channel(connection, NODE, CHANNEL), count


def fill(store: Store, number_of_frames: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eskin_cloud.store.compaction._LONGEST", LENGTH)  # many rows
    random = np.random.default_rng(1)
    for first in range(0, number_of_frames, 1000):
        said = []
        for number in range(first, min(first + 1000, number_of_frames)):
            at = START + number * LENGTH
            lo = random.random(SAMPLES)
            said.append(stretch(number, lo, lo + 1, time=(at, at), dt=PERIOD))
        put(store, *said)
    compact_all(store)
    build(store)
    if not isinstance(store.location, Path):
        # As the server's own housekeeping does: entries of frames that are compacted count, too.
        engine = create_engine(store.location, isolation_level="AUTOCOMMIT")
        with engine.connect() as connection:
            connection.execute(text("VACUUM ANALYZE"))
        engine.dispose()


def drawn(random: np.random.Generator, length: int) -> Window:
    """A window of any length, anywhere over the data or beyond."""
    span = int(10 ** random.uniform(0, np.log10(2 * length)))
    start = START + int(random.integers(-length // 10, length))
    return Window(start, start + span)


@pytest.mark.nightly
@pytest.mark.parametrize("number_of_frames", [2400, pytest.param(6000, marks=pytest.mark.nightly)])
def test_random_windows_of_a_built_store_are_answered_from_few_rows(
    store: Store, number_of_frames: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    span = number_of_frames * LENGTH
    fill(store, number_of_frames, monkeypatch)
    random = np.random.default_rng(2)
    most = 0
    for _ in range(40):
        window, points = drawn(random, span), int(random.choice([1, 10, 300, 1000]))
        with asked(store) as (connection, channel, count):
            read_series(connection, channel, window, points=points)
            most = max(most, count())
        with asked(store) as (connection, channel, count):
            verdicts_of(connection, channel, window, SETTLED)
            most = max(most, count())
    assert most <= FEW
    with asked(store) as (connection, channel, count):
        read_series(connection, channel, Window(START, START + span), points=1000)
        assert 16 < count() <= FEW // 2, "the whole takes less than its parts"
    with asked(store) as (connection, _, count):
        connection.execute(select(patch_rows.c.t)).all()
        assert count() > FEW, "a look at every row is noticed"
