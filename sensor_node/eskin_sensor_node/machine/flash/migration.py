"""The way of a flash's file from what lay in the clear to what is sealed.

Its version (``user_version``) tells how far it went, so that a power cut only delays it.
"""

from __future__ import annotations

import logging
import sqlite3
from typing import TYPE_CHECKING, Final

from eskin.errors import FlashError
from eskin.privacy.sealed_message import whole_minutes

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

log = logging.getLogger(__name__)

_SEALED: Final = 1
"""All records are sealed, yet the file's free pages may hold what they once were."""
_CLEAN: Final = 2
_PATIENCE: Final = 5000
"""Milliseconds that a statement waits for another process."""


def connect(path: Path) -> sqlite3.Connection:
    """Open a flash's file: what is committed is on the disk.

    Raises:
        sqlite3.Error: It cannot be opened.
    """
    db = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    db.execute(f"PRAGMA busy_timeout = {_PATIENCE}")
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("PRAGMA synchronous = FULL")
    return db


def migrate(
    db: sqlite3.Connection, path: Path, *, schema: Sequence[str], seal: Sequence[str]
) -> None:
    """Make a flash's tables, or bring older ones to the present version, durably.

    Args:
        db: The file, in autocommit mode, with a write-ahead log.
        path: Where it is.
        schema: Statements that make what is missing.
        seal: Statements that seal what lies in the clear; they may ask ``minute_before`` and
            ``minute_behind`` for the whole minutes that enclose a moment.

    Raises:
        FlashError: It was written by a newer version.
        sqlite3.Error: It cannot be written.
    """
    version: int = db.execute("PRAGMA user_version").fetchone()[0]
    if not 0 <= version <= _CLEAN:
        raise FlashError(
            f"{path}: flash has version {version}, this node knows {_CLEAN}; run the newer node, "
            "or choose another flash.path"
        )
    if version == _CLEAN:
        return
    if version < _SEALED:
        version = _seal(db, path, schema, seal)
    if version < _CLEAN:
        _clean(db, path)


def _seal(db: sqlite3.Connection, path: Path, schema: Sequence[str], seal: Sequence[str]) -> int:
    db.create_function("minute_before", 1, lambda moment: whole_minutes((moment, moment))[0])
    db.create_function("minute_behind", 1, lambda moment: whole_minutes((moment, moment))[1])
    db.execute("BEGIN IMMEDIATE")
    old = db.execute("SELECT 1 FROM sqlite_master WHERE name = 'message'").fetchone() is not None
    for statement in (*schema, *(seal if old else ())):
        db.execute(statement)
    version = _SEALED if old else _CLEAN
    db.execute(f"PRAGMA user_version = {version}")
    db.execute("COMMIT")
    if old:
        log.warning("flash sealed, it lay in the clear before: path=%s", path)
    return version


def _clean(db: sqlite3.Connection, path: Path) -> None:
    """Write the file anew without its free pages, and empty the log."""
    db.execute("VACUUM")
    db.execute("PRAGMA busy_timeout = 0")  # a start waits for no reader
    busy = db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]
    db.execute(f"PRAGMA busy_timeout = {_PATIENCE}")
    if busy:
        log.warning("another process reads the flash, cleaned at the next start: path=%s", path)
        return
    db.execute(f"PRAGMA user_version = {_CLEAN}")
