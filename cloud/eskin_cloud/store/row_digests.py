"""A digest for each row, kept by triggers, in SQLite.

SQLite's pages have no checksums, so a bit that flips on the disk is read as valid. Triggers keep a
digest in each row, whatever statement writes it; an update of a damaged row clears the digest, so
that the row stays damaged. PostgreSQL has checksums of its own (``initdb --data-checksums``) and
needs no digests.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, TypeVar

from sqlalchemy import DDL, BigInteger, Column, event, select

from eskin.runtime.digest import row_checksum
from eskin_cloud.store.damage import DamagedRowError, report_damaged

if TYPE_CHECKING:
    import sqlite3
    from collections.abc import Iterable, Mapping

    from sqlalchemy import Connection, RowMapping, Table
    from sqlalchemy.schema import ExecutableDDLElement

RowT = TypeVar("RowT", bound="Mapping[str, Any] | RowMapping")

ROW_DIGEST: Final = "row_digest"
CHECKED_TABLES: Final[list[Table]] = []
"""The tables whose rows have a digest."""
_FUNCTION: Final = "row_checksum"
_LONGEST_KEY: Final = 32
_ROWS_AT_ONCE: Final = 1000


def add_row_digest(table: Table) -> None:
    """Add a digest to each row of a table."""
    names = [column.name for column in table.columns]
    table.append_column(Column(ROW_DIGEST, BigInteger))
    CHECKED_TABLES.append(table)
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


def register_checksum(connection: sqlite3.Connection) -> None:
    """Register the SQL function that the triggers call."""
    connection.create_function(
        _FUNCTION, -1, lambda *values: row_checksum(values), deterministic=True
    )


def intact_rows(connection: Connection, table: Table, rows: Iterable[RowT]) -> list[RowT]:
    """The intact rows; damaged ones are reported and dropped.

    Args:
        connection: Where the rows were read.
        table: Their table.
        rows: With all columns.
    """
    found = list(rows)
    if connection.dialect.name != "sqlite":
        return found
    whole = _whole(table, found)
    for row, is_whole in zip(found, whole, strict=True):
        if not is_whole:
            report_damaged(table.name, _place(table, row))
    return [row for row, is_whole in zip(found, whole, strict=True) if is_whole]


def require_intact_row(connection: Connection, table: Table, row: RowT | None) -> RowT | None:
    """Verify one row, if there is one.

    Raises:
        DamagedRowError: It is damaged.
    """
    if row is not None and not intact_rows(connection, table, [row]):
        raise DamagedRowError(_place(table, row))
    return row


def without_digest(row: RowMapping) -> dict[str, Any]:
    """A row without its digest, as statements write it."""
    return {name: value for name, value in row.items() if name != ROW_DIGEST}


def empty_row(table: Table) -> dict[str, Any]:
    """``None`` for each nullable column of a table."""
    return {c.name: None for c in table.columns if c.nullable and c.name != ROW_DIGEST}


def find_damaged(connection: Connection, table: Table) -> list[str]:
    """Find and report all damaged rows of a table.

    The digests are compared here, not in SQL: SQLite passes no invalid UTF-8 to a function.
    """
    if connection.dialect.name != "sqlite":
        return []
    found: list[str] = []
    rows = connection.execute(select(table).execution_options(yield_per=_ROWS_AT_ONCE)).mappings()
    for part in rows.partitions():
        whole = _whole(table, part)
        found += (
            _place(table, row) for row, is_whole in zip(part, whole, strict=True) if not is_whole
        )
    for place in found:
        report_damaged(table.name, place)
    return found


def _whole(table: Table, rows: Iterable[RowT]) -> list[bool]:
    """Whether each row has the digest of its values."""
    names = _names(table)
    return [row[ROW_DIGEST] == row_checksum(row[name] for name in names) for row in rows]


def _names(table: Table) -> list[str]:
    return [column.name for column in table.columns if column.name != ROW_DIGEST]


def _place(table: Table, row: Mapping[str, Any] | RowMapping) -> str:
    # The slot follows from the node's name.
    names = (column.name for column in table.primary_key.columns if column.name != "slot")
    values = (row[name] for name in names)
    key = (each.hex() if isinstance(each, bytes) else str(each) for each in values)
    return f"{table.name} {' '.join(each[:_LONGEST_KEY] for each in key)}"
