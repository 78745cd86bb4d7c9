"""Whether a database file is whole: a worn disk may give back something else than was written."""

from __future__ import annotations

import sqlite3
from typing import Final

UNREADABLE: Final = (sqlite3.Error, UnicodeDecodeError, MemoryError)
"""What reading a damaged file raises: where not even its error is a text, and where a page asks for
more memory than there is, too."""


def require_whole(connection: sqlite3.Connection) -> None:
    """Check structure and types of a whole file, before anything relies on them.

    Raises:
        sqlite3.DatabaseError: It is damaged.
    """
    found = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
    if found != "ok":
        raise sqlite3.DatabaseError(f"the file is damaged: {found[:200]}; bring back a copy")


def why(error: BaseException) -> str:
    """What one of `UNREADABLE` says, in words."""
    if isinstance(error, MemoryError):
        return "the file is damaged, or there is no memory left"
    return str(error)
