"""Check the pages and indexes of an SQLite store.

A flipped bit in an index hides a row or finds another one, which no row's digest shows. SQLite
finds it by reading the whole table: small tables are checked when the store opens, large ones by
`jobs.integrity`. Indexes are rebuilt from their tables.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError

from eskin.errors import StoreError
from eskin.wire.slot import slot_of
from eskin_cloud.store.damage import FrameHeader, PatchRowHeader, report_damaged
from eskin_cloud.store.row_digests import CHECKED_TABLES, find_damaged
from eskin_cloud.store.schema.frame_tables import frames, patch_rows, patch_tiles
from eskin_cloud.store.schema.sealed_tables import sealed_messages
from eskin_cloud.store.schema.tables import (
    dead_letters,
    digests,
    events,
    metadata,
    sequences,
)

if TYPE_CHECKING:
    from sqlalchemy import Connection, Table

log = logging.getLogger(__name__)

LARGE_TABLES: Final = (
    frames,
    patch_rows,
    sealed_messages,
    events,
    digests,
    sequences,
    dead_letters,
    patch_tiles,
)
"""Tables that grow with the nodes' messages."""
_HEADERS: Final[dict[str, type[FrameHeader | PatchRowHeader]]] = {
    frames.name: FrameHeader,
    patch_rows.name: PatchRowHeader,
}


class DamagedTableError(StoreError):
    """A table or an index is damaged, and cannot be rebuilt."""


def check_small_tables(connection: Connection) -> None:
    """Check the small tables, rebuild damaged indexes, and report damaged rows.

    Args:
        connection: In a transaction that may write.

    Raises:
        StoreError: Pages are damaged.
    """
    for table in metadata.sorted_tables:
        if table not in LARGE_TABLES and find_corruption(connection, table) is not None:
            rebuild_indexes(connection, table)
        if table not in LARGE_TABLES and table in CHECKED_TABLES:
            find_damaged(connection, table)


def find_corruption(connection: Connection, table: Table) -> str | None:
    """SQLite's description of a damage; ``None`` if intact, or on PostgreSQL."""
    if connection.dialect.name != "sqlite":
        return None
    check = f"PRAGMA integrity_check({table.name})"
    found = str(connection.exec_driver_sql(check).scalars().first())
    return None if found == "ok" else found


def rebuild_indexes(connection: Connection, table: Table) -> None:
    """Rebuild a table's indexes if they are damaged.

    Raises:
        DamagedTableError: The table's own pages are damaged.
    """
    fault = find_corruption(connection, table)
    if fault is None:
        return
    try:
        connection.exec_driver_sql(f"REINDEX {table.name}")
    except IntegrityError as error:  # a damaged key equals another one
        fault = f"{fault}; {error.orig}"
    else:
        log.error("indexes rebuilt: table=%s reason=%s", table.name, fault)
        fault = find_corruption(connection, table)
    if fault is not None:
        raise DamagedTableError(
            f"table {table.name} is damaged: {fault}; restore a backup of the store"
        )


def find_hidden_rows(connection: Connection, table: Table) -> None:
    """Report rows of frames with damaged headers: their readers may not find them by their keys."""
    header = _HEADERS.get(table.name)
    if header is None:
        return
    columns = (table.c[name] for name in ("slot", *header._fields, "head"))
    for row in connection.execute(select(*columns)).mappings():
        found = header.of(row)
        if found.checksum() != row["head"] or row["slot"] != slot_of(row["node"]):
            report_damaged(table.name, found.place)
