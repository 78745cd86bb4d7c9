"""The version of the schema: tables are made once; a store of another version is refused.

There is one version, for SQLite and PostgreSQL alike. Whoever makes the tables holds the store's
write lock, so that of several clouds that start at once one does it, and the others find them.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

from sqlalchemy import func, insert, inspect, select, text

from eskin.errors import StoreError
from eskin_cloud.store import clock_state  # noqa: F401 - its table
from eskin_cloud.store.schema import tile_tables  # noqa: F401 - their tables
from eskin_cloud.store.schema.sealed_tables import veiled
from eskin_cloud.store.schema.tables import blocks, feed, metadata, versions
from eskin_cloud.store.write import gateways, missing_messages, node_sites  # noqa: F401 - their tables

if TYPE_CHECKING:
    from sqlalchemy import Connection

VERSION: Final = 1
_STANDING: Final = select(func.max(versions.c.version))


def prepare(connection: Connection, *, now: int) -> None:
    """Make the tables where there are none, within the connection's transaction.

    Args:
        connection: With an open transaction that nobody else writes beside.
        now: UTC ns, for the record.

    Raises:
        StoreError: The store is of another version.
    """
    if not inspect(connection).has_table(versions.name):
        metadata.create_all(connection)
        _keep_whole(connection)
        connection.execute(insert(feed).values(name="feed", cursor=0, ids=os.urandom(32)))
        connection.execute(insert(versions).values(version=VERSION, applied=now))
    require_current(connection)


def require_current(connection: Connection) -> None:
    """Check that the schema is the one that this program knows.

    Raises:
        StoreError: It is another one.
    """
    standing = connection.execute(_STANDING).scalar_one() or 0
    if standing != VERSION:
        raise StoreError(
            f"the store has schema version {standing}, this program knows {VERSION}; "
            "start the program that made it, or use another store"
        )


def _keep_whole(connection: Connection) -> None:
    """Keep a block in its row, as it is: PostgreSQL would cut and try to compress it elsewhere."""
    if connection.dialect.name == "postgresql":
        for name in (blocks.name, veiled.name):
            connection.execute(text(f"ALTER TABLE {name} ALTER COLUMN data SET STORAGE EXTERNAL"))
            connection.execute(text(f"ALTER TABLE {name} SET (toast_tuple_target = 8160)"))
