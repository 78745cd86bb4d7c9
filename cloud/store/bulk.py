"""Many rows at once, past all that a statement costs for each: the way of the blocks."""

from __future__ import annotations

from operator import itemgetter
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import BigInteger, Double, Integer, LargeBinary
from sqlalchemy.exc import DBAPIError

from cloud.store.words import Words

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Column, Connection, Table

    from cloud.store.ledger import Row

_TYPES: Final = {
    BigInteger: "int8",
    Double: "float8",
    Integer: "int4",
    LargeBinary: "bytea",
    Words: "text",
}
"""What COPY's binary format calls our columns' types."""


def insert_many(connection: Connection, table: Table, rows: Sequence[Row]) -> None:
    """Add rows to a table; every one has every column, and no text holds a NUL.

    Raises:
        DBAPIError: As from any other statement.
    """
    names = [column.name for column in table.columns]
    values = map(itemgetter(*names), rows)
    if connection.dialect.name == "postgresql":
        _copy(connection, table, values)
        return
    places = ", ".join("?" * len(names))
    words = f"INSERT INTO {table.name} ({', '.join(names)}) VALUES ({places})"  # noqa: S608 - ours
    connection.exec_driver_sql(words, list(values))


def _copy(connection: Connection, table: Table, values: Any) -> None:
    """COPY (PostgreSQL's documentation, "Binary Format")."""
    names = ", ".join(column.name for column in table.columns)
    words = f"COPY {table.name} ({names}) FROM STDIN (FORMAT BINARY)"
    driver: Any = connection.connection.driver_connection
    try:
        with driver.cursor() as cursor, cursor.copy(words) as copy:
            copy.set_types([_type(column) for column in table.columns])
            for row in values:
                copy.write_row(row)
    except connection.dialect.loaded_dbapi.Error as error:
        raise DBAPIError.instance(
            words, None, error, connection.dialect.loaded_dbapi.Error, dialect=connection.dialect
        ) from error


def _type(column: Column[Any]) -> str:
    return _TYPES[type(column.type)]
