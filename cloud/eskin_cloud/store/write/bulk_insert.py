"""Many rows at once, past all that a statement costs for each: the way of the blocks."""

from __future__ import annotations

from operator import itemgetter
from typing import TYPE_CHECKING, Any, Protocol

from eskin_cloud.store.pg_copy import Copying

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection, Table

    from eskin_cloud.store.write.write_cache import Row


class Inserts(Protocol):
    """Rows on their way into a table: all columns in their order; no text holds a NUL."""

    def add(self, row: tuple[Any, ...]) -> None:
        """Add a row.

        Raises:
            DBAPIError: As from any other statement, of this row or of those before it.
        """
        ...

    def finish(self) -> None:
        """Have them in the table before the connection's next statement.

        Raises:
            DBAPIError: As from any other statement.
        """
        ...


def insert_many(connection: Connection, table: Table, rows: Sequence[Row]) -> None:
    """Add rows to a table; each of them has every column.

    Raises:
        DBAPIError: As from any other statement.
    """
    into, values = inserts(connection, table), itemgetter(*table.columns.keys())
    for row in rows:
        into.add(values(row))
    into.finish()


def inserts(connection: Connection, table: Table) -> Inserts:
    """The fastest way into a table."""
    if connection.dialect.name == "postgresql":
        return _Copied(connection, table)
    return _Gathered(connection, table)


class _Gathered:
    """One prepared statement for all, as SQLite works within this process."""

    def __init__(self, connection: Connection, table: Table) -> None:
        names = [column.name for column in table.columns]
        places = ", ".join("?" * len(names))
        self._words = f"INSERT INTO {table.name} ({', '.join(names)}) VALUES ({places})"  # noqa: S608 - ours
        self._connection = connection
        self._rows: list[tuple[Any, ...]] = []

    def add(self, row: tuple[Any, ...]) -> None:
        self._rows.append(row)

    def finish(self) -> None:
        if self._rows:
            self._connection.exec_driver_sql(self._words, self._rows)
        self._rows = []


class _Copied:
    """A COPY, at whose rows the server works while the next ones are made."""

    def __init__(self, connection: Connection, table: Table) -> None:
        self._connection, self._table = connection, table
        self._copying: Copying | None = None

    def add(self, row: tuple[Any, ...]) -> None:
        if self._copying is None or self._copying.ended:  # by a statement since the last row
            self._copying = Copying.into(self._connection, self._table)
        self._copying.write(row)

    def finish(self) -> None:
        """The next statement ends it: until then the server need not be waited for."""
