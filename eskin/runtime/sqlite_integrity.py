"""Detect corruption of a database file."""

from __future__ import annotations

import logging
import sqlite3
from typing import Final

log = logging.getLogger(__name__)

UNREADABLE: Final = (sqlite3.Error, UnicodeDecodeError, MemoryError)
"""What reading a damaged file raises: where not even its error is a text, and where a page asks for
more memory than there is, too."""


def require_whole(connection: sqlite3.Connection) -> None:
    """Check structure, types and indexes of a whole file, before anything relies on them.

    Where the tables are whole and only their indexes are not, these are made anew: else a message
    might be found and not be deleted. Nothing is lost by that.

    Raises:
        sqlite3.DatabaseError: It is damaged.
    """
    if _fault(connection, "integrity_check") is None:
        return
    if _fault(connection, "quick_check") is None:
        connection.execute("REINDEX")
        path = connection.execute("PRAGMA database_list").fetchone()[2]
        log.warning("indexes did not fit their tables and were made anew: path=%s", path)
    fault = _fault(connection, "integrity_check")
    if fault is not None:
        raise sqlite3.DatabaseError(f"the file is damaged: {fault[:200]}; bring back a copy")


def _fault(connection: sqlite3.Connection, check: str) -> str | None:
    found: str = connection.execute(f"PRAGMA {check}(1)").fetchone()[0]
    return None if found == "ok" else found


def why(error: BaseException) -> str:
    """What one of `UNREADABLE` says, in words."""
    if isinstance(error, MemoryError):
        return "the file is damaged, or there is no memory left"
    return str(error)
