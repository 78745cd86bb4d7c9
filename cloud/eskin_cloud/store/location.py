"""The location of a store: an SQLite file or a PostgreSQL database."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

from sqlalchemy import URL, make_url
from sqlalchemy.exc import ArgumentError

from eskin.runtime.net import is_loopback
from eskin_cloud.store import postgres, sqlite

if TYPE_CHECKING:
    from sqlalchemy import Engine

StoreLocation: TypeAlias = Path | URL
GROUPS: Final = 4
"""Groups of slots that a process writes to PostgreSQL at once, each by a connection."""

_PORT: Final = re.compile(r":\d+$")
_INVALID_URL: Final = "is no PostgreSQL URL; write postgresql://USER@HOST:PORT/DATABASE"


def parse_url(text: str) -> URL:
    """Parse a server's URL, and set the driver.

    Raises:
        ValueError: The text is no such URL.
    """
    try:
        url = make_url(text)
    except (ArgumentError, ValueError) as error:
        raise ValueError(_INVALID_URL) from error
    if url.drivername != "postgresql" or not url.database or not _hosts(url):
        raise ValueError(_INVALID_URL)
    if url.password is not None:
        raise ValueError("must not hold a password; put it into store.password_file")
    unknown = sorted(set(url.query) - {"host"})
    if unknown:
        raise ValueError(f"{unknown[0]!r} is not allowed in the URL; only host is")
    return url.set(drivername="postgresql+psycopg")


def writing_engine(place: StoreLocation) -> Engine:
    """An engine with one connection, whose transactions hold the write lock of central rows."""
    if isinstance(place, Path):
        return sqlite.writing_engine(place)
    return postgres.writing_engine(place)


def slot_engines(place: StoreLocation) -> list[Engine]:
    """Engines that write rows of nodes, one for each group of slots.

    None for SQLite, which has one writer: that of `writing_engine`.
    """
    if isinstance(place, Path):
        return []
    return [postgres.slot_engine(place) for _ in range(GROUPS)]


def reading_engine(place: StoreLocation, *, readers: int, name: str = "") -> Engine:
    """An engine with ``readers`` connections; each transaction sees one state of the store.

    Args:
        place: The store.
        readers: How many.
        name: The process's, as other processes on a server see it.
    """
    if isinstance(place, Path):
        return sqlite.reading_engine(place, readers=readers)
    return postgres.reading_engine(place, readers=readers, name=name)


def is_local(url: URL) -> bool:
    """Whether the server is on this machine: loopback or a Unix socket."""
    return all(host.startswith("/") or is_loopback(host) for host in _hosts(url))


def _hosts(url: URL) -> tuple[str, ...]:
    """The servers that the URL names, without their ports."""
    named = (url.host,) if url.host else url.normalized_query.get("host", ())
    return tuple(host if host.startswith("/") else _PORT.sub("", host) for host in named)


def describe(place: StoreLocation) -> str:
    """The location as text, without credentials."""
    if isinstance(place, Path):
        return str(place)
    bare = place.set(drivername="postgresql", username=None, password=None, query={})
    return bare.render_as_string()
