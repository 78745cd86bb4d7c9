"""The spool's tables, and the way from each version to the next.

A migration and its record (``user_version``) share a transaction.
"""

from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING, Final

from eskin.errors import SpoolError

if TYPE_CHECKING:
    from pathlib import Path

_CHECKPOINT_PAGES: Final = 1000

MIGRATIONS: Final = (
    (
        # AUTOINCREMENT: an id never comes back, so that order of ids is order of acceptance.
        """CREATE TABLE messages (
            id INTEGER PRIMARY KEY AUTOINCREMENT,
            node TEXT NOT NULL,
            received INTEGER NOT NULL,
            body BLOB NOT NULL
        ) STRICT""",
        """CREATE TABLE nodes (
            node TEXT PRIMARY KEY,
            held_boot INTEGER NOT NULL,
            held_sequence INTEGER NOT NULL,
            ranges BLOB NOT NULL,
            status BLOB,
            thumbprint BLOB
        ) STRICT, WITHOUT ROWID""",
        """CREATE TABLE senders (
            thumbprint BLOB PRIMARY KEY,
            expires INTEGER NOT NULL,
            leaf BLOB NOT NULL,
            issuer BLOB NOT NULL
        ) STRICT, WITHOUT ROWID""",
        """CREATE TABLE dead_letters (
            id INTEGER PRIMARY KEY AUTOINCREMENT,
            at INTEGER NOT NULL,
            node TEXT NOT NULL,
            reason TEXT NOT NULL,
            body BLOB NOT NULL,
            digest BLOB NOT NULL UNIQUE
        ) STRICT""",
    ),
)


def migrate(connection: sqlite3.Connection) -> None:
    """Bring a spool to the present version.

    Raises:
        SpoolError: It was written by a newer gateway.
    """
    version: int = connection.execute("PRAGMA user_version").fetchone()[0]
    if version > len(MIGRATIONS):
        raise SpoolError(
            f"spool has version {version}, this gateway knows {len(MIGRATIONS)}; "
            "run the newer gateway, or choose another spool.path"
        )
    for number, statements in enumerate(MIGRATIONS[version:], start=version + 1):
        connection.execute("BEGIN IMMEDIATE")
        for statement in statements:
            connection.execute(statement)
        connection.execute(f"PRAGMA user_version = {number}")
        connection.execute("COMMIT")


def connect(path: Path, synchronous: str) -> sqlite3.Connection:
    """Open the file; ``synchronous``: ``FULL`` where a commit must be durable, else ``NORMAL``."""
    connection = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute(f"PRAGMA synchronous = {synchronous}")
    # Debian's SQLite overwrites what is deleted: twice the writing, for what the cloud has anyway.
    connection.execute("PRAGMA secure_delete = OFF")
    connection.execute(f"PRAGMA wal_autocheckpoint = {_CHECKPOINT_PAGES}")
    connection.execute("PRAGMA busy_timeout = 5000")
    return connection
