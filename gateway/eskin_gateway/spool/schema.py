"""The spool's tables; a spool of another version is refused."""

from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING, Final

from eskin.errors import SpoolError

if TYPE_CHECKING:
    from pathlib import Path

_CHECKPOINT_PAGES: Final = 1000

VERSION: Final = 1
_TABLES: Final = (
    # digest: of all else but the id; once a message is opened, no signature covers it any more.
    # AUTOINCREMENT: an id never comes back, so that order of ids is order of acceptance.
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
    # The greatest number of each boot that the cloud has confirmed.
    """CREATE TABLE confirmed (
        node TEXT NOT NULL,
        boot INTEGER NOT NULL,
        last INTEGER NOT NULL,
        PRIMARY KEY (node, boot)
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
)


def prepare(connection: sqlite3.Connection) -> None:
    """Make the tables where there are none, in one transaction.

    Raises:
        SpoolError: The spool is of another version.
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
    """Open the file; ``synchronous``: ``FULL`` where a commit must be durable, else ``NORMAL``."""
    connection = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
    # A damaged text is read as another one, which its row's digest tells.
    connection.text_factory = lambda text: text.decode(errors="replace")
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute(f"PRAGMA synchronous = {synchronous}")
    # Debian's SQLite overwrites what is deleted: twice the writing, for what the cloud has anyway.
    connection.execute("PRAGMA secure_delete = OFF")
    connection.execute(f"PRAGMA wal_autocheckpoint = {_CHECKPOINT_PAGES}")
    connection.execute("PRAGMA busy_timeout = 5000")
    return connection
