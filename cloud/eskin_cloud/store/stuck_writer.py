"""A process that hangs while it holds PostgreSQL's write lock, and others that wait for it."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sqlalchemy import text

from eskin_cloud.store.postgres import WRITING

if TYPE_CHECKING:
    from eskin_cloud.store.store import Store

log = logging.getLogger(__name__)

_PATIENCE_S: Final = 60.0
"""As long as the server waits for the next statement of a transaction."""
_END: Final = text(
    "SELECT pg_terminate_backend(a.pid) FROM pg_locks l JOIN pg_stat_activity a ON a.pid = l.pid "
    "WHERE l.locktype = 'advisory' AND l.granted AND a.datname = current_database() "
    "AND (l.classid::bigint << 32 | l.objid::bigint) = :lock AND a.wait_event = 'ClientRead' "
    "AND a.state = 'active' AND a.state_change < clock_timestamp() - make_interval(secs => :after)"
)


def end_stuck_writer(store: Store, *, after_s: float = _PATIENCE_S) -> bool:
    """End the session of a process that hangs in the middle of a COPY, with the write lock.

    The server ends what is idle within a transaction by itself, and gives up statements that take
    too long, but never a COPY whose rows do not come: no timeout of its own counts then.

    Args:
        store: The store; with an SQLite file there is nothing to do.
        after_s: Nothing has come for so long.

    Returns:
        Whether there was one.

    Raises:
        StoreError: The store cannot be read.
    """
    if isinstance(store.place, Path):
        return False
    with store.read() as connection:
        ended = connection.execute(_END, {"lock": WRITING, "after": after_s}).all()
    if ended:
        log.warning("ended a writer that hung for %g s with the store's write lock", after_s)
    return bool(ended)
