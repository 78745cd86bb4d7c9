"""The version of the schema: create the tables once, reject a store of another version.

The cursor key is made with the tables, so it also distinguishes one store from another.

A cloud creates the tables under the store's write lock, so that of several clouds that start at
once, one creates them.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

from sqlalchemy import insert, inspect, select, text

from eskin.errors import StoreError
from eskin_cloud.store.feed_entry import FEED_START
from eskin_cloud.store.schema.alarm_tables import alarm_state
from eskin_cloud.store.schema.frame_tables import frames, patch_rows
from eskin_cloud.store.schema.sealed_tables import sealed_messages
from eskin_cloud.store.schema.tables import feed, metadata, versions

if TYPE_CHECKING:
    from sqlalchemy import Connection

VERSION: Final = 1
_LATEST: Final = (
    select(versions.c.version, versions.c.cursor_key).order_by(versions.c.version.desc()).limit(1)
)


def create_tables(connection: Connection, *, now: int) -> bytes:
    """Create the tables if there are none.

    Args:
        connection: In a transaction that holds the write lock.
        now: UTC ns.

    Returns:
        The store's cursor key.

    Raises:
        StoreError: The store has another version.
    """
    if not inspect(connection).has_table(versions.name):
        metadata.create_all(connection)
        _store_data_inline(connection)
        rows = [
            {"slot": slot, "cursor": cursor, "compacted": cursor}
            for slot, cursor in enumerate(FEED_START.cursors)
        ]
        connection.execute(insert(feed), rows)
        counters = {"until": 0, "version": 0, "last_alarm": 0, "last_number": 0}
        connection.execute(insert(alarm_state).values(name="alarms", **counters))
        connection.execute(
            insert(versions).values(version=VERSION, applied=now, cursor_key=os.urandom(32))
        )
    return require_version(connection)


def require_version(connection: Connection, cursor_key: bytes | None = None) -> bytes:
    """Check the schema's version, and that it is still the store that was opened.

    Args:
        connection: In a transaction.
        cursor_key: The key of the store that was opened; ``None`` accepts each.

    Returns:
        The store's cursor key.

    Raises:
        StoreError: It is another version, or another store.
    """
    standing, key = connection.execute(_LATEST).one_or_none() or (0, b"")
    if standing != VERSION:
        raise StoreError(
            f"the store has schema version {standing}, this program knows {VERSION}; "
            "start the program that made it, or use another store"
        )
    if cursor_key not in {None, key}:
        raise StoreError(
            "the store has another cursor key than when this cloud opened it: it was replaced, or "
            "another store was moved into it; restart this cloud"
        )
    return bytes(key)


def _store_data_inline(connection: Connection) -> None:
    """Store messages inline: PostgreSQL would move them to a TOAST table and compress them."""
    if connection.dialect.name == "postgresql":
        for table in (sealed_messages, frames, patch_rows):
            name = table.name
            connection.execute(text(f"ALTER TABLE {name} ALTER COLUMN data SET STORAGE EXTERNAL"))
            connection.execute(text(f"ALTER TABLE {name} SET (toast_tuple_target = 8160)"))
