"""Statements that add, change and remove rows by their keys.

They are made once: to make one takes as long as to have it done.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import and_, bindparam, delete, insert, update

from eskin_cloud.store.schema.tables import channels, nodes, sequences

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sqlalchemy import ColumnElement, Table


def placed(table: Table, rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows as parameters of `CHANGE` and `REMOVE`, their keys to find them by."""
    keys = {column.name for column in table.primary_key.columns}
    return [
        {f"at_{name}" if name in keys else name: value for name, value in row.items()}
        for row in rows
    ]


def _is_at(table: Table) -> ColumnElement[bool]:
    """Whether a row is the one whose key is given beside its new values."""
    return and_(*(column == bindparam(f"at_{column.name}") for column in table.primary_key.columns))


_KEPT: Final = (nodes, channels, sequences)
ADD: Final = {table: insert(table) for table in _KEPT}
CHANGE: Final = {table: update(table).where(_is_at(table)) for table in _KEPT}
REMOVE: Final = {table: delete(table).where(_is_at(table)) for table in _KEPT}
