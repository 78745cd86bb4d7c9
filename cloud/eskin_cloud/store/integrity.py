"""Whether an SQLite store is whole: pages, and indexes that fit their tables.

A flipped bit in an index hides a row, or finds another one, which no row's digest tells. SQLite
tells by reading a table as a whole: small ones when the store is opened, those that may have
gigabytes by `jobs.integrity`. Indexes are made anew from their tables, whose rows have digests.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from eskin.errors import StoreError
from eskin_cloud.store.row_digests import CHECKED, find_damaged
from eskin_cloud.store.schema.sealed_tables import veiled
from eskin_cloud.store.schema.tables import (
    blocks,
    dead_letters,
    digests,
    events,
    metadata,
    sequences,
)
from eskin_cloud.store.schema.tile_tables import tiles

if TYPE_CHECKING:
    from sqlalchemy import Connection, Table

log = logging.getLogger(__name__)

LARGE: Final = (blocks, veiled, events, digests, sequences, dead_letters, tiles)
"""Tables that grow with what nodes say."""


def require_whole(connection: Connection) -> None:
    """Check the tables that are small, and mend their indexes; damaged rows are noted.

    Args:
        connection: In a transaction that may write.

    Raises:
        StoreError: Pages are damaged.
    """
    for table in metadata.sorted_tables:
        if table not in LARGE and find_fault(connection, table) is not None:
            mend(connection, table)
        if table not in LARGE and table in CHECKED:
            find_damaged(connection, table)


def find_fault(connection: Connection, table: Table) -> str | None:
    """What is wrong with a table or its indexes, in SQLite's words; ``None`` on a server."""
    if connection.dialect.name != "sqlite":
        return None
    check = f"PRAGMA integrity_check({table.name})"
    found = str(connection.exec_driver_sql(check).scalars().first())
    return None if found == "ok" else found


def mend(connection: Connection, table: Table) -> None:
    """Make a table's indexes anew.

    Raises:
        StoreError: That does not help: the table's own pages are damaged.
    """
    fault = find_fault(connection, table)
    if fault is None:
        return
    connection.exec_driver_sql(f"REINDEX {table.name}")
    log.error("indexes did not fit and were made anew: table=%s reason=%s", table.name, fault)
    fault = find_fault(connection, table)
    if fault is not None:
        raise StoreError(f"table {table.name} is damaged: {fault}; bring back a copy of the store")
