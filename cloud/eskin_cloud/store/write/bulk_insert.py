"""Insert many rows by the fastest way of each database."""

from __future__ import annotations

from operator import itemgetter
from typing import TYPE_CHECKING, Any, Protocol

from sqlalchemy import insert

from eskin_cloud.store.pg_copy import CopyStream
from eskin_cloud.store.shard_groups import session_is_distributed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection, Table

    from eskin_cloud.store.write.write_cache import Row


class BulkInsert(Protocol):
    """Inserts rows, each with all columns in order; no text holds a NUL."""

    def add(self, row: tuple[Any, ...]) -> None:
        """Add a row.

        Raises:
            DBAPIError: As from any other statement, for this row or an earlier one.
        """
        ...

    def finish(self) -> None:
        """Insert all rows before the connection's next statement.

        Raises:
            DBAPIError: As from any other statement.
        """
        ...


def insert_many(connection: Connection, table: Table, rows: Sequence[Row]) -> None:
    """Insert rows, each with every column.

    Raises:
        DBAPIError: As from any other statement.
    """
    into, values = bulk_insert(connection, table), itemgetter(*table.columns.keys())
    for row in rows:
        into.add(values(row))
    into.finish()


def bulk_insert(connection: Connection, table: Table) -> BulkInsert:
    """The fastest way to insert into a table.

    On Citus that is an INSERT: a COPY takes two phases to commit, also into one shard, and hides
    which error a worker has.
    """
    if connection.dialect.name == "sqlite":
        return _BatchInsert(connection, table)
    if session_is_distributed(connection):
        return _ManyInsert(connection, table)
    return _CopyInsert(connection, table)


class _BatchInsert:
    """One prepared statement for all rows, for SQLite."""

    def __init__(self, connection: Connection, table: Table) -> None:
        names = [column.name for column in table.columns]
        places = ", ".join("?" * len(names))
        self._statement = f"INSERT INTO {table.name} ({', '.join(names)}) VALUES ({places})"  # noqa: S608 - ours
        self._connection = connection
        self._rows: list[tuple[Any, ...]] = []

    def add(self, row: tuple[Any, ...]) -> None:
        self._rows.append(row)

    def finish(self) -> None:
        if self._rows:
            self._connection.exec_driver_sql(self._statement, self._rows)
        self._rows = []


class _ManyInsert:
    """INSERT statements in a pipeline, for Citus."""

    def __init__(self, connection: Connection, table: Table) -> None:
        self._connection, self._table = connection, table
        self._names = table.columns.keys()
        self._rows: list[dict[str, Any]] = []

    def add(self, row: tuple[Any, ...]) -> None:
        self._rows.append(dict(zip(self._names, row, strict=True)))

    def finish(self) -> None:
        if self._rows:
            self._connection.execute(insert(self._table), self._rows)
        self._rows = []


class _CopyInsert:
    """A COPY, for PostgreSQL; the server inserts rows while the next ones are made."""

    def __init__(self, connection: Connection, table: Table) -> None:
        self._connection, self._table = connection, table
        self._copying: CopyStream | None = None

    def add(self, row: tuple[Any, ...]) -> None:
        if self._copying is None or self._copying.ended:  # by a statement since the last row
            self._copying = CopyStream.open(self._connection, self._table)
        self._copying.write(row)

    def finish(self) -> None:
        """Do nothing: the next statement ends the COPY."""
