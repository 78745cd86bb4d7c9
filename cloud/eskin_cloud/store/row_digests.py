"""A digest for each row of the tables that people and gateways are answered from, in SQLite.

SQLite's pages have no checksums, so that a bit which flips on the disk is read as if it had been
written. Triggers keep each row's digest beside it, whatever statement writes it; a
damaged row that is written again stays damaged, as its digest goes. A PostgreSQL server has
checksums of its own (``initdb --data-checksums``), and no digests here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, TypeVar

from sqlalchemy import DDL, BigInteger, Column, event, func, select

from eskin.runtime.digest import row_checksum
from eskin_cloud.store.damage import DamagedRowError, note_damaged

if TYPE_CHECKING:
    import sqlite3
    from collections.abc import Iterable, Mapping

    from sqlalchemy import Connection, RowMapping, Table
    from sqlalchemy.schema import ExecutableDDLElement

RowT = TypeVar("RowT", bound="Mapping[str, Any] | RowMapping")

ROW_DIGEST: Final = "row_digest"
CHECKED: Final[list[Table]] = []
"""The tables whose rows have a digest."""
_FUNCTION: Final = "row_checksum"
_LONGEST_KEY: Final = 32


def keep_checked(table: Table) -> None:
    """Have each row of a table keep its digest."""
    names = [column.name for column in table.columns]
    table.append_column(Column(ROW_DIGEST, BigInteger))
    CHECKED.append(table)
    new, old = (", ".join(f"{row}.{name}" for name in names) for row in ("NEW", "OLD"))
    keep = f"UPDATE {table.name} SET {ROW_DIGEST}"  # noqa: S608 - our own names
    here = "WHERE rowid = NEW.rowid; END"
    made = f"{_FUNCTION}({new})"
    was_sound = f"OLD.{ROW_DIGEST} IS {_FUNCTION}({old})"
    for name, words in {
        "insert": f"INSERT ON {table.name} BEGIN {keep} = {made} {here}",
        "update": f"UPDATE OF {', '.join(names)} ON {table.name} BEGIN "
        f"{keep} = CASE WHEN {was_sound} THEN {made} END {here}",
    }.items():
        trigger: ExecutableDDLElement = DDL(  # type: ignore[no-untyped-call]  # untyped there
            f"CREATE TRIGGER {table.name}_digest_{name} AFTER {words}"
        )
        event.listen(table, "after_create", trigger.execute_if(dialect="sqlite"))


def give_function(connection: sqlite3.Connection) -> None:
    """Give a connection the function that the triggers call."""
    connection.create_function(
        _FUNCTION, -1, lambda *values: row_checksum(values), deterministic=True
    )


def sound(connection: Connection, table: Table, rows: Iterable[RowT]) -> list[RowT]:
    """The rows that are as they were written; the others are noted, and left out.

    Args:
        connection: From which they come.
        table: Whose they are.
        rows: With all its columns.
    """
    found = list(rows)
    if connection.dialect.name != "sqlite":
        return found
    names = _names(table)
    whole = [row[ROW_DIGEST] == row_checksum(row[name] for name in names) for row in found]
    for row, is_whole in zip(found, whole, strict=True):
        if not is_whole:
            note_damaged(table.name, _place(table, row))
    return [row for row, is_whole in zip(found, whole, strict=True) if is_whole]


def require_sound_row(connection: Connection, table: Table, row: RowT | None) -> RowT | None:
    """The same of one row, where there is one.

    Raises:
        DamagedRowError: It is not as it was written.
    """
    if row is not None and not sound(connection, table, [row]):
        raise DamagedRowError(_place(table, row))
    return row


def without_digest(row: RowMapping) -> dict[str, Any]:
    """A row as it is written; the store keeps its digest itself."""
    return {name: value for name, value in row.items() if name != ROW_DIGEST}


def find_damaged(connection: Connection, table: Table) -> list[str]:
    """The damaged rows of a whole table; they are noted."""
    if connection.dialect.name != "sqlite":
        return []
    values = (table.c[name] for name in _names(table))
    differs = table.c[ROW_DIGEST].is_distinct_from(getattr(func, _FUNCTION)(*values))
    rows = connection.execute(select(*table.primary_key.columns).where(differs)).mappings()
    places = [_place(table, row) for row in rows]
    for place in places:
        note_damaged(table.name, place)
    return places


def _names(table: Table) -> list[str]:
    return [column.name for column in table.columns if column.name != ROW_DIGEST]


def _place(table: Table, row: Mapping[str, Any] | RowMapping) -> str:
    key = (str(row[column.name])[:_LONGEST_KEY] for column in table.primary_key.columns)
    return f"{table.name} {' '.join(key)}"
