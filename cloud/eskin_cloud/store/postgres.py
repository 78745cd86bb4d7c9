"""PostgreSQL engines: for central rows, for rows of nodes, and for reading."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import URL, Engine, create_engine, event, text
from sqlalchemy.pool import QueuePool

from eskin_cloud.store.pg_copy import end_copy_before_statements

if TYPE_CHECKING:
    from sqlalchemy import Connection

WRITE_LOCK: Final = 0x65736B696E
"""Key of the advisory lock of the central rows' writer: "eskin" in ASCII."""
_CONNECT_S: Final = 5
# Keepalives let the server notice a connection that was reset on the way; otherwise it would keep
# that connection's locks for a minute.
_OPTIONS: Final = (
    "-c timezone=UTC -c idle_in_transaction_session_timeout=60s "
    "-c tcp_keepalives_idle=5 -c tcp_keepalives_interval=5 -c tcp_keepalives_count=3"
)
# Transactions take tens of milliseconds: one that is idle for long is of a process that hangs.
_WRITER_OPTIONS: Final = (
    "-c synchronous_commit=on -c lock_timeout=10s -c statement_timeout=30s "
    "-c idle_in_transaction_session_timeout=20s"
)
_APPLICATION: Final = "eskin cloud "
_APPLICATIONS: Final = text(
    "SELECT DISTINCT application_name FROM pg_stat_activity "
    "WHERE datname = current_database() AND application_name LIKE :pattern"
)
_READER_OPTIONS: Final = (
    "-c default_transaction_read_only=on -c default_transaction_isolation=repeatable\\ read "
    "-c statement_timeout=60s"
)


def writing_engine(url: URL) -> Engine:
    """An engine with one connection that writes central rows, as one process at a time does.

    Its transactions take a lock when they begin, so each sees all that was written before, by
    whichever process, as with SQLite.
    """
    engine = slot_engine(url)

    @event.listens_for(engine, "begin")
    def lock(connection: Connection) -> None:
        connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({WRITE_LOCK})")

    return engine


def slot_engine(url: URL) -> Engine:
    """An engine with one connection that writes rows of nodes, whose slots it locks."""
    engine = _engine(url, size=1, options=_WRITER_OPTIONS)
    end_copy_before_statements(engine)
    return engine


def reading_engine(url: URL, *, readers: int, name: str = "") -> Engine:
    """An engine with ``readers`` connections; each transaction sees one state of the store.

    Args:
        url: The database.
        readers: How many.
        name: The process's; `living_clouds` lists it while there is a connection.
    """
    options = _READER_OPTIONS
    return _engine(
        url, size=readers, options=options, pre_ping=True, application=_APPLICATION + name
    )


def living_clouds(connection: Connection) -> set[str]:
    """The names of the processes that are connected to the database."""
    names = connection.execute(_APPLICATIONS, {"pattern": f"{_APPLICATION}_%"}).scalars()
    return {name.removeprefix(_APPLICATION) for name in names}


def driver_arguments(url: URL) -> dict[str, Any]:
    """Arguments of libpq for a connection without SQLAlchemy."""
    _, words = url.get_dialect()().create_connect_args(url)
    return {**words, **_connect_arguments("", _APPLICATION)}


def _connect_arguments(options: str, application: str) -> dict[str, Any]:
    """Timeouts, so that no call waits without end for an unreachable server."""
    return {
        # Of several servers, and after a failover: a standby refuses writes, and its rows are old.
        "target_session_attrs": "primary",
        "connect_timeout": _CONNECT_S,
        "keepalives_idle": 5,
        "keepalives_interval": 5,
        "keepalives_count": 3,
        "tcp_user_timeout": 20_000,
        "application_name": application.rstrip(),
        "options": f"{_OPTIONS} {options}",
    }


def _engine(
    url: URL, *, size: int, options: str, pre_ping: bool = False, application: str = _APPLICATION
) -> Engine:
    return create_engine(
        url,
        poolclass=QueuePool,
        pool_size=size,
        max_overflow=0,
        pool_timeout=30,
        pool_pre_ping=pre_ping,
        connect_args=_connect_arguments(options, application),
    )
