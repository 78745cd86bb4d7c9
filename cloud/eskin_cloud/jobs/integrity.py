"""Check an SQLite store's large tables in the background: at the start and daily."""

from __future__ import annotations

import asyncio
import logging
from functools import partial
from typing import TYPE_CHECKING, Final

from eskin.errors import StoreError
from eskin_cloud.jobs.periodic import run_periodically
from eskin_cloud.store.db_errors import is_corrupt
from eskin_cloud.store.integrity import (
    LARGE_TABLES,
    DamagedTableError,
    find_corruption,
    find_hidden_rows,
    rebuild_indexes,
)
from eskin_cloud.store.row_digests import CHECKED_TABLES, find_damaged

if TYPE_CHECKING:
    from sqlalchemy import Table

    from eskin_cloud.app_state import AppState
    from eskin_cloud.store import Store

log = logging.getLogger(__name__)

_DAY_S: Final = 86_400.0


async def check_integrity(cloud: AppState, stopping: asyncio.Event) -> None:
    """Look for damaged rows and indexes once a day."""
    work = partial(_look, cloud, stopping)
    await run_periodically(
        "looking for damage", work, cloud=cloud, stopping=stopping, every_s=_DAY_S
    )


async def _look(cloud: AppState, stopping: asyncio.Event) -> None:
    for table in LARGE_TABLES:
        if stopping.is_set():
            return
        try:
            await asyncio.to_thread(look_at, cloud.store, table)
        except StoreError as error:  # the other tables may be whole
            log.error("store damaged: %s", error)  # noqa: TRY400 - no fault of ours


def look_at(store: Store, table: Table) -> None:
    """Report a table's damaged rows, and rebuild its indexes if they are damaged.

    If they cannot be rebuilt, the store is not read any more: an index might hide rows.

    Raises:
        StoreError: Its pages are damaged, or the store cannot be read or written.
    """
    try:
        with store.read() as connection:
            is_whole = find_corruption(connection, table) is None
        if not is_whole:
            store.write(partial(rebuild_indexes, table=table)).result()
            with store.read() as connection:
                find_hidden_rows(connection, table)
    except StoreError as error:
        if isinstance(error, DamagedTableError) or is_corrupt(error):
            store.damage = f"{error}"
        raise
    if table in CHECKED_TABLES:
        with store.read() as connection:
            find_damaged(connection, table)
