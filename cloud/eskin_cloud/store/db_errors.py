"""What a fault of the database means, and what to do about it."""

from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING, Final

from sqlalchemy.exc import DataError, IntegrityError, SQLAlchemyError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

if TYPE_CHECKING:
    from collections.abc import Mapping

_SLOW: Final = "it is too slow; see what else it does, and give it more memory or fewer readers"
_OF_FILES: Final[Mapping[int, str]] = {
    sqlite3.SQLITE_FULL: "free space",
    sqlite3.SQLITE_BUSY: "another program keeps the file for itself; end that one",
    sqlite3.SQLITE_CORRUPT: "the file is damaged; bring back a copy",
    sqlite3.SQLITE_NOTADB: "the file is damaged; bring back a copy",
}
"""By SQLite's primary result code."""
_REMEDIES: Final[Mapping[str, str]] = {
    "53100": "its disk is full; free space there",
    "53200": "it has no memory left; give it more",
    "53300": "it has no connection left; raise max_connections, or lower store.readers",
    "55P03": _SLOW,
    "57014": _SLOW,
    "25006": "it only reads; connect to the primary server",
    "28P01": "the password is wrong; see store.password_file",
    "28000": "the user may not come in; see pg_hba.conf",
    "3D000": "there is no such database; make it with createdb",
    "42501": "the user lacks rights; make it the database's owner",
}
"""By SQLSTATE, PostgreSQL's appendix A."""
_REFUSALS: Final = (
    ("password authentication failed", "28P01"),
    ("no password supplied", "28P01"),
    ("pg_hba.conf", "28000"),
    ("too many clients", "53300"),
    ("remaining connection slots", "53300"),
    ('" does not exist', "3D000"),
)
"""What a server says when it lets nobody in."""
_AWAY: Final = "it does not answer; start it, or set store.url right"


def is_of_the_store(error: Exception) -> bool:
    """Whether the store itself is at fault, and not what it was asked to do.

    So are memory and disk: SQLite's driver tells of memory without an error of its own.
    """
    of_the_work = isinstance(error, DataError | IntegrityError)
    return (
        isinstance(error, SQLAlchemyError | MemoryError | OSError | UnicodeDecodeError)
        and not of_the_work
    )


def explain(error: Exception) -> str:
    """Why the store failed, in one line, and what to do.

    Args:
        error: As SQLAlchemy or the driver raised it.
    """
    if isinstance(error, PoolTimeoutError):
        return "no connection came free in time; ask less at once, or raise store.readers"
    if isinstance(error, MemoryError):
        return "there is no memory left; give it more"
    if isinstance(error, UnicodeDecodeError):  # not even its error is a text
        return "the file is damaged; bring back a copy"
    cause = getattr(error, "orig", None) or error
    said = "; ".join(line.strip() for line in str(cause).splitlines() if line.strip())
    remedy = _remedy(cause)
    return said if remedy is None else f"{said}: {remedy}"


def _remedy(cause: BaseException) -> str | None:
    said = str(cause)
    if not hasattr(cause, "sqlstate"):  # SQLite's errors have codes of their own
        return _OF_FILES.get(getattr(cause, "sqlite_errorcode", 0) & 0xFF)
    state = cause.sqlstate
    if state is None:  # the driver's own, about its connection: it tells the server's words only
        return next((_REMEDIES[code] for words, code in _REFUSALS if words in said), _AWAY)
    return _AWAY if state.startswith(("08", "57P")) else _REMEDIES.get(state)
