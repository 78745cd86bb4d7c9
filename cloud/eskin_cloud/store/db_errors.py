"""Explain database errors, with a remedy."""

from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING, Final

from sqlalchemy.exc import DataError, IntegrityError, SQLAlchemyError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

if TYPE_CHECKING:
    from collections.abc import Mapping

_SLOW: Final = "the server is too slow; check its load, add memory, or lower store.readers"
_SQLITE_REMEDIES: Final[Mapping[int, str]] = {
    sqlite3.SQLITE_FULL: "free space",
    sqlite3.SQLITE_BUSY: "another program has locked the file; end that program",
    sqlite3.SQLITE_CORRUPT: "the file is damaged; restore a backup",
    sqlite3.SQLITE_NOTADB: "the file is damaged; restore a backup",
}
"""By SQLite's primary result code."""
_REMEDIES: Final[Mapping[str, str]] = {
    "53100": "the server's disk is full; free space",
    "53200": "the server is out of memory; add memory",
    "53300": "the server has no connection left; raise max_connections, or lower store.readers",
    "55P03": _SLOW,
    "57014": _SLOW,
    "25006": "the server is read-only; connect to the primary server",
    "28P01": "the password is wrong; see store.password_file",
    "28000": "the user is not admitted; see pg_hba.conf",
    "3D000": "there is no such database; create it with createdb",
    "42501": "the user lacks rights; make it the database's owner",
}
"""By SQLSTATE, PostgreSQL's appendix A."""
_LOGIN_ERRORS: Final = (
    ("password authentication failed", "28P01"),
    ("no password supplied", "28P01"),
    ("pg_hba.conf", "28000"),
    ("too many clients", "53300"),
    ("remaining connection slots", "53300"),
    ('" does not exist', "3D000"),
    ("hot standby mode", "25006"),
)
"""Messages of a server that rejects a login, or is a standby, with their SQLSTATE."""
_UNREACHABLE: Final = "the server does not answer; start it, or correct store.url"


def is_store_fault(error: Exception) -> bool:
    """Whether the store failed, rather than the statement's data.

    Lack of memory and disk space counts, too.
    """
    of_the_data = isinstance(error, DataError | IntegrityError)
    return (
        isinstance(error, SQLAlchemyError | MemoryError | OSError | UnicodeDecodeError)
        and not of_the_data
    )


def is_corrupt(error: BaseException) -> bool:
    """Whether SQLite found damaged pages."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, sqlite3.Error):
        cause = cause.__cause__
    return cause is not None and _primary_code(cause) in {
        sqlite3.SQLITE_CORRUPT,
        sqlite3.SQLITE_NOTADB,
    }


def explain(error: Exception) -> str:
    """Why the store failed, with a remedy, in one line.

    Args:
        error: As SQLAlchemy or the driver raised it.
    """
    if isinstance(error, PoolTimeoutError):
        return "no connection became free in time; send fewer queries, or raise store.readers"
    if isinstance(error, MemoryError):
        return "out of memory; add memory"
    if isinstance(error, UnicodeDecodeError):  # the error's own text is damaged
        return "the file is damaged; restore a backup"
    cause = getattr(error, "orig", None) or error
    text = "; ".join(line.strip() for line in str(cause).splitlines() if line.strip())
    remedy = _remedy(cause)
    return text if remedy is None else f"{text}: {remedy}"


def _remedy(cause: BaseException) -> str | None:
    text = str(cause)
    if not hasattr(cause, "sqlstate"):  # SQLite's errors have codes of their own
        return _SQLITE_REMEDIES.get(_primary_code(cause))
    state = cause.sqlstate
    if state is None:  # raised by the driver, which passes on the server's text only
        return next(
            (_REMEDIES[code] for words, code in _LOGIN_ERRORS if words in text), _UNREACHABLE
        )
    return _UNREACHABLE if state.startswith(("08", "57P")) else _REMEDIES.get(state)


def _primary_code(cause: BaseException) -> int:
    """SQLite's primary result code."""
    return getattr(cause, "sqlite_errorcode", 0) & 0xFF
