"""End a process that hangs while other writers of PostgreSQL wait for its locks."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sqlalchemy import text

if TYPE_CHECKING:
    from eskin_cloud.store.store import Store

log = logging.getLogger(__name__)

_TIMEOUT_S: Final = 20.0
"""The server's own timeout for an idle transaction."""
_TERMINATE: Final = text(
    "SELECT pg_terminate_backend(a.pid) FROM pg_stat_activity a "
    "WHERE a.pid IN (SELECT unnest(pg_blocking_pids(w.pid)) FROM pg_stat_activity w "
    "WHERE w.datname = current_database() AND w.wait_event_type = 'Lock') "
    "AND a.wait_event = 'ClientRead' AND a.state = 'active' "
    "AND a.state_change < clock_timestamp() - make_interval(secs => :after)"
)


def end_stuck_writer(store: Store, *, after_s: float = _TIMEOUT_S) -> bool:
    """End the session of a writer that hangs in the middle of a COPY while others wait for it.

    The server ends idle transactions and slow statements by itself, but no timeout of it covers a
    COPY whose rows do not arrive.

    Args:
        store: The store; a call with an SQLite store does nothing.
        after_s: End a session that sent nothing for this long.

    Returns:
        Whether a session was ended.

    Raises:
        StoreError: The store cannot be read.
    """
    if isinstance(store.location, Path):
        return False
    with store.read() as connection:
        ended = connection.execute(_TERMINATE, {"after": after_s}).all()
    if ended:
        log.warning("stuck writer ended: idle_s=%g", after_s)
    return bool(ended)
