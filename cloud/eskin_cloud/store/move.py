"""Moving a store to another place: page by page, resumable, compared to the last byte.

The source must not be written meanwhile. Rows go over in the order of their keys, each page in one
transaction, so that what has arrived is always a first part of the source, and a move that was
interrupted goes on behind it. Until all has arrived and was compared, no cloud writes there.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import func, select, tuple_, update
from sqlalchemy.exc import SQLAlchemyError

from eskin.errors import StoreError
from eskin_cloud.store.db_errors import explain
from eskin_cloud.store.location import reading_engine, show, writing_engine
from eskin_cloud.store.schema.tables import feed, metadata, versions
from eskin_cloud.store.version import prepare, require_current
from eskin_cloud.store.write.bulk_insert import insert_many
from eskin_cloud.store.write.write_cache import MOVING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sqlalchemy import Connection, Engine, RowMapping, Select, Table

    from eskin_cloud.store.location import Place

_PAGE: Final = 500
TABLES: Final = tuple(t for t in metadata.sorted_tables if t not in {versions, feed})
"""What is moved; the feed's row goes last, and says that all has arrived."""


@dataclass(slots=True)
class Steps:
    """How far a move is: each row is carried over, then compared.

    Attributes:
        total: Rows to carry and to compare.
        told: Called with what is done and the total.
        done: What is done.
    """

    total: int
    told: Callable[[int, int], None]
    done: int = 0

    def advance(self, rows: int) -> None:
        """Some more rows are done."""
        self.done += rows
        self.told(self.done, self.total)


def move(
    source: Place,
    target: Place,
    *,
    now: int,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> dict[str, int]:
    """Carry everything over, or go on with it, then compare.

    Args:
        source: A store that nobody writes.
        target: Where it goes; empty, or with a part of it from a move before.
        now: UTC ns, for the record of when its tables were made.
        progress: Told steps done and steps in all.

    Returns:
        How many rows each table has.

    Raises:
        StoreError: One of the two cannot be used, the target holds something else, or the two
            differ afterwards.
    """
    reading, writing = reading_engine(source, readers=1), writing_engine(target)
    try:
        with reading.begin() as before:
            require_current(before)
            counts = {table.name: _count(before, table) for table in TABLES}
            steps = Steps(2 * sum(counts.values()), progress)
            _prepare(writing, target, now)
            for table in TABLES:
                _carry(before, writing, table, steps)
            with writing.begin() as after:
                for table in TABLES:
                    _compare(before, after, table, steps)
                cursor, ids = before.execute(select(feed.c.cursor, feed.c.ids)).one()
                after.execute(update(feed).values(cursor=cursor, ids=ids, writer=None))
            return counts
    except SQLAlchemyError as error:
        raise StoreError(
            f"{show(source)} to {show(target)}: the move failed: {explain(error)}; then start it "
            "again: it goes on where it was"
        ) from error
    finally:
        reading.dispose()
        writing.dispose()


def _prepare(writing: Engine, target: Place, now: int) -> None:
    """Make the target's tables, and keep clouds away from it."""
    with writing.begin() as connection:
        prepare(connection, now=now)
        if connection.execute(select(feed.c.writer)).scalar_one() == MOVING:
            return
        full = next((table.name for table in TABLES if _count(connection, table)), None)
        if full is not None:
            raise StoreError(
                f"{show(target)}: is no empty store: it has {full}; name an empty database"
            )
        connection.execute(update(feed).values(writer=MOVING))


def _carry(before: Connection, writing: Engine, table: Table, steps: Steps) -> None:
    with writing.begin() as connection:
        steps.advance(_count(connection, table))
        last = connection.execute(_in_order(table, descending=True).limit(1)).mappings().first()
    for page in _pages(before, table, last):
        with writing.begin() as connection:
            insert_many(connection, table, [dict(row) for row in page])
        steps.advance(len(page))


def _compare(before: Connection, after: Connection, table: Table, steps: Steps) -> None:
    for old, new in zip_longest(_pages(before, table), _pages(after, table), fillvalue=()):
        if _digest(old) != _digest(new):
            raise StoreError(f"{table.name}: what arrived differs from its source; move anew")
        steps.advance(len(old))


def _pages(
    connection: Connection, table: Table, last: RowMapping | None = None
) -> Iterator[Sequence[RowMapping]]:
    """A table's rows after one of them, in the order of their key."""
    key = tuple_(*table.primary_key.columns)
    while True:
        query = _in_order(table).limit(_PAGE)
        if last is not None:
            query = query.where(key > tuple_(*(last[c.name] for c in table.primary_key.columns)))
        page = connection.execute(query).mappings().all()
        if not page:
            return
        yield page
        last = page[-1]


def _in_order(table: Table, *, descending: bool = False) -> Select[Any]:
    columns = table.primary_key.columns
    return select(table).order_by(*(c.desc() if descending else c for c in columns))


def _digest(page: Sequence[RowMapping]) -> bytes:
    return hashlib.sha256(repr([tuple(row.values()) for row in page]).encode()).digest()


def _count(connection: Connection, table: Table) -> int:
    return connection.execute(select(func.count()).select_from(table)).scalar_one()
