"""Move a store to another location: page by page, resumable, and verified.

The source must not be written meanwhile. Rows are copied in the order of their keys, one page a
transaction, so that an interrupted move resumes after the last copied row. No cloud writes to the
target until all rows are copied and compared.
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
from eskin_cloud.store.location import describe, reading_engine, writing_engine
from eskin_cloud.store.row_digests import without_digest
from eskin_cloud.store.schema.alarm_tables import alarm_state
from eskin_cloud.store.schema.tables import feed, metadata, versions
from eskin_cloud.store.shard_groups import read_groups, shard_places, shard_places_now
from eskin_cloud.store.version import create_tables, require_version
from eskin_cloud.store.write.bulk_insert import insert_many
from eskin_cloud.store.write.write_cache import MOVING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sqlalchemy import Connection, Engine, RowMapping, Select, Table

    from eskin_cloud.store.location import StoreLocation

_PAGE: Final = 500
TABLES: Final = tuple(t for t in metadata.sorted_tables if t not in {versions, feed, alarm_state})
"""The tables to copy; the rows of ``alarm_state`` and ``feed`` follow, and those of ``feed``
mark completion."""


@dataclass(slots=True)
class MoveProgress:
    """The progress of a move: each row is copied, then compared.

    Attributes:
        total: Rows to copy, plus rows to compare.
        report: Called with ``done`` and ``total``.
        done: Rows done.
    """

    total: int
    report: Callable[[int, int], None]
    done: int = 0

    def advance(self, rows: int) -> None:
        """Count and report more rows."""
        self.done += rows
        self.report(self.done, self.total)


def move(
    source: StoreLocation,
    target: StoreLocation,
    *,
    now: int,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> dict[str, int]:
    """Copy all rows, or resume an interrupted move, then compare.

    Args:
        source: A store that no cloud writes.
        target: Empty, or with the rows of an interrupted move.
        now: UTC ns.
        progress: Called with steps done and steps in total.

    Returns:
        The number of rows of each table.

    Raises:
        StoreError: A store cannot be used, the target holds other rows, or the two differ
            afterwards.
    """
    reading, writing = reading_engine(source, readers=2), writing_engine(target)
    try:
        with reading.begin() as before:
            require_version(before)
            places = shard_places(before)
            counts = {table.name: _count(before, table) for table in TABLES}
            steps = MoveProgress(2 * sum(counts.values()), progress)
            _prepare(writing, target, now)
            for table in TABLES:
                _copy(before, writing, table, steps)
            with writing.begin() as after:
                for table in TABLES:
                    _compare(before, after, table, steps)
                if places is not None and shard_places_now(reading) != places:
                    raise StoreError(
                        f"a shard of {describe(source)} was moved meanwhile, so the copy may lack "
                        "its rows; clear the target and move again while no shard moves"
                    )
                key = before.execute(select(versions.c.cursor_key)).scalar_one()
                cursors = before.execute(select(feed.c.slot, feed.c.cursor, feed.c.compacted)).all()
                counters = before.execute(select(alarm_state)).mappings().one()
                after.execute(update(alarm_state).values(**without_digest(counters)))
                after.execute(update(versions).values(cursor_key=key))
                for slot, cursor, compacted in cursors:
                    here = update(feed).where(feed.c.slot == slot)
                    values = here.values(cursor=cursor, compacted=compacted, writer=None)
                    after.execute(values)
            return counts
    except SQLAlchemyError as error:
        raise StoreError(
            f"move of {describe(source)} to {describe(target)} failed: {explain(error)}; "
            "then start it again to resume"
        ) from error
    finally:
        reading.dispose()
        writing.dispose()


def _prepare(writing: Engine, target: StoreLocation, now: int) -> None:
    """Create the target's tables, and keep clouds from writing there."""
    with writing.begin() as connection:
        create_tables(connection, now=now)
        # Locks all slots first: what a cloud has just stored is seen, and nothing comes after it.
        writers = select(feed.c.writer).order_by(feed.c.slot).with_for_update()
        locked = [
            writer
            for slots in read_groups(connection)
            for writer in connection.execute(writers.where(feed.c.slot.in_(slots))).scalars()
        ]
        if MOVING in locked:
            return
        full = next((table.name for table in TABLES if _count(connection, table)), None)
        if full is not None:
            raise StoreError(
                f"{describe(target)}: not empty: it has rows of {full}; name an empty database"
            )
        connection.execute(update(feed).values(writer=MOVING))


def _copy(before: Connection, writing: Engine, table: Table, steps: MoveProgress) -> None:
    with writing.begin() as connection:
        steps.advance(_count(connection, table))
        last = connection.execute(_in_order(table, descending=True).limit(1)).mappings().first()
    for page in _pages(before, table, last):
        with writing.begin() as connection:
            insert_many(connection, table, [dict(row) for row in page])
        steps.advance(len(page))


def _compare(before: Connection, after: Connection, table: Table, steps: MoveProgress) -> None:
    for old, new in zip_longest(_pages(before, table), _pages(after, table), fillvalue=()):
        if _digest(old) != _digest(new):
            raise StoreError(
                f"{table.name}: the copy differs from the source; clear the target and move again"
            )
        steps.advance(len(old))


def _pages(
    connection: Connection, table: Table, last: RowMapping | None = None
) -> Iterator[Sequence[RowMapping]]:
    """A table's rows after ``last``, in the order of the primary key."""
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
