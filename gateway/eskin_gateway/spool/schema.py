"""The spool's tables."""

from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING, Final

from eskin.errors import SpoolError

if TYPE_CHECKING:
    from pathlib import Path

_CHECKPOINT_PAGES: Final = 1000

VERSION: Final = 1
_TABLES: Final = (
    # digest: of all columns but the id; no signature covers a decrypted message.
    # AUTOINCREMENT: ids are never reused, so their order is the order of acceptance.
    """CREATE TABLE messages (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        node TEXT NOT NULL,
        received INTEGER NOT NULL,
        body BLOB NOT NULL,
        boot INTEGER,
        sequence INTEGER,
        digest INTEGER NOT NULL
    ) STRICT""",
    """CREATE TABLE nodes (
        node TEXT PRIMARY KEY,
        held_boot INTEGER NOT NULL,
        held_sequence INTEGER NOT NULL,
        ranges BLOB NOT NULL,
        status BLOB,
        thumbprint BLOB,
        digest INTEGER NOT NULL
    ) STRICT, WITHOUT ROWID""",
    # The last sequence of each boot that the cloud has confirmed.
    """CREATE TABLE confirmed (
        node TEXT NOT NULL,
        boot INTEGER NOT NULL,
        last_sequence INTEGER NOT NULL,
        PRIMARY KEY (node, boot)
    ) STRICT, WITHOUT ROWID""",
    """CREATE TABLE certificates (
        thumbprint BLOB PRIMARY KEY,
        expires INTEGER NOT NULL,
        leaf BLOB NOT NULL,
        issuer BLOB NOT NULL
    ) STRICT, WITHOUT ROWID""",
    """CREATE TABLE dead_letters (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        time INTEGER NOT NULL,
        node TEXT NOT NULL,
        reason TEXT NOT NULL,
        body BLOB NOT NULL,
        fingerprint BLOB NOT NULL UNIQUE
    ) STRICT""",
)


def create_tables(connection: sqlite3.Connection) -> None:
    """Create the tables of a new file, in one transaction.

    Raises:
        SpoolError: The file has another version.
    """
    version: int = connection.execute("PRAGMA user_version").fetchone()[0]
    if version not in {0, VERSION}:
        raise SpoolError(
            f"spool has version {version}, this gateway knows {VERSION}; "
            "run the gateway that made it, or choose another spool.path"
        )
    if version == 0:
        connection.execute("BEGIN IMMEDIATE")
        for statement in _TABLES:
            connection.execute(statement)
        connection.execute(f"PRAGMA user_version = {VERSION}")
        connection.execute("COMMIT")


def connect(path: Path, synchronous: str) -> sqlite3.Connection:
    """Open the file; ``synchronous`` is ``FULL`` for durable commits, else ``NORMAL``."""
    connection = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
    # A damaged text is decoded to another text, which the row's digest detects.
    connection.text_factory = lambda text: text.decode(errors="replace")
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute(f"PRAGMA synchronous = {synchronous}")
    # Debian's SQLite overwrites deleted rows: twice the writing, for data that the cloud has.
    connection.execute("PRAGMA secure_delete = OFF")
    connection.execute(f"PRAGMA wal_autocheckpoint = {_CHECKPOINT_PAGES}")
    connection.execute("PRAGMA busy_timeout = 5000")
    return connection
