"""SQLite engines: one connection writes, several read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import URL, Engine, create_engine, event
from sqlalchemy.pool import QueuePool

from eskin_cloud.store.row_digests import register_checksum

if TYPE_CHECKING:
    import sqlite3
    from pathlib import Path

    from sqlalchemy import Connection

_BUSY_S: Final = 10.0
_PRAGMAS: Final = (
    "page_size=16384",  # of a new file; several frames fit a page
    "journal_mode=WAL",
    "synchronous=FULL",
    "foreign_keys=ON",
    "cache_size=-32768",
)


def writing_engine(path: Path) -> Engine:
    """An engine with one connection, whose transactions begin with the write lock."""
    return _engine(path, size=1, begin="BEGIN IMMEDIATE")


def reading_engine(path: Path, *, readers: int) -> Engine:
    """An engine with ``readers`` connections; each transaction sees one state of the store."""
    return _engine(path, size=readers, begin="BEGIN", query_only=True)


def _engine(path: Path, *, size: int, begin: str, query_only: bool = False) -> Engine:
    engine = create_engine(
        URL.create("sqlite", database=str(path)),
        poolclass=QueuePool,
        pool_size=size,
        max_overflow=0,
        pool_timeout=30,
        connect_args={"check_same_thread": False, "timeout": _BUSY_S},
    )

    @event.listens_for(engine, "connect")
    def connect(connection: sqlite3.Connection, _: object) -> None:
        connection.isolation_level = None  # `start` begins transactions
        register_checksum(connection)
        connection.text_factory = lambda text: text.decode(errors="replace")
        for pragma in _PRAGMAS:
            connection.execute(f"PRAGMA {pragma}")
        if query_only:
            connection.execute("PRAGMA query_only=ON")

    @event.listens_for(engine, "begin")
    def start(connection: Connection) -> None:
        connection.exec_driver_sql(begin)

    return engine
