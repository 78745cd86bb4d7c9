"""Where a store is: an SQLite file, or a database of a PostgreSQL server."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

from sqlalchemy import URL, make_url
from sqlalchemy.exc import ArgumentError

from eskin.runtime.loopback import is_loopback
from eskin_cloud.store import postgres, sqlite

if TYPE_CHECKING:
    from sqlalchemy import Engine

Place: TypeAlias = Path | URL

_ALLOWED: Final = "is none of a server; write postgresql://USER@HOST:PORT/DATABASE"


def read_url(text: str) -> URL:
    """A server's URL, for our driver.

    Raises:
        ValueError: It is none; says what is allowed.
    """
    try:
        url = make_url(text)
    except (ArgumentError, ValueError) as error:
        raise ValueError(_ALLOWED) from error
    if url.drivername != "postgresql" or not url.database or not _hosts(url):
        raise ValueError(_ALLOWED)
    if url.password is not None:
        raise ValueError("a password is no part of it; put it into store.password_file")
    unknown = sorted(set(url.query) - {"host"})
    if unknown:
        raise ValueError(f"{unknown[0]!r} is not allowed in it; only host is")
    return url.set(drivername="postgresql+psycopg")


def writing_engine(place: Place) -> Engine:
    """An engine with one connection; each transaction has the store for itself."""
    if isinstance(place, Path):
        return sqlite.writing_engine(place)
    return postgres.writing_engine(place)


def reading_engine(place: Place, *, readers: int) -> Engine:
    """An engine with ``readers`` connections; each transaction sees one state of the store."""
    if isinstance(place, Path):
        return sqlite.reading_engine(place, readers=readers)
    return postgres.reading_engine(place, readers=readers)


def stays_here(url: URL) -> bool:
    """Whether a connection stays on this machine: loopback, or a folder with a Unix socket."""
    return all(host.startswith("/") or is_loopback(host) for host in _hosts(url))


def _hosts(url: URL) -> tuple[str, ...]:
    return (url.host,) if url.host else tuple(url.normalized_query.get("host", ()))


def show(place: Place) -> str:
    """A place as people may read it, without a password."""
    if isinstance(place, Path):
        return str(place)
    bare = place.set(drivername="postgresql", username=None, password=None, query={})
    return bare.render_as_string()
