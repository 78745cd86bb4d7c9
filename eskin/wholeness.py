"""Whether a database file is whole: a worn disk may give back something else than was written."""

from __future__ import annotations

import sqlite3
from typing import Final

UNREADABLE: Final = (sqlite3.Error, UnicodeDecodeError)
"""What reading a damaged file raises; the latter where not even its error is a text."""


def require_whole(connection: sqlite3.Connection) -> None:
    """Check structure and types of a whole file, before anything relies on them.

    Raises:
        sqlite3.DatabaseError: It is damaged.
    """
    found = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
    if found != "ok":
        raise sqlite3.DatabaseError(f"the file is damaged: {found[:200]}; bring back a copy")
