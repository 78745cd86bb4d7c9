"""Migrations, in order; each and its record share one transaction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import Connection, func, insert, inspect, select, text

from cloud.store.events import ENERGY
from cloud.store.schema import audit_log, commands, feed, metadata, nodes, states, versions
from cloud.store.sealed import erased_subjects, removals, veiled, wearers
from eskin.errors import StoreError

if TYPE_CHECKING:
    from collections.abc import Callable


SEALED: Final = [veiled, erased_subjects, wearers, removals]


def _first(connection: Connection) -> None:
    later = {commands, states, audit_log, *SEALED}
    metadata.create_all(connection, [t for t in metadata.sorted_tables if t not in later])
    connection.execute(insert(feed).values(name="feed", cursor=0))


def _second(connection: Connection) -> None:
    metadata.create_all(connection, [commands, states])


def _third(connection: Connection) -> None:
    metadata.create_all(connection, [audit_log])


def _fourth(connection: Connection) -> None:
    standing = {column["name"] for column in inspect(connection).get_columns(nodes.name)}
    for name in ENERGY:
        if name not in standing:
            kind = nodes.c[name].type.compile(connection.dialect)
            connection.execute(text(f"ALTER TABLE {nodes.name} ADD COLUMN {name} {kind}"))


def _fifth(connection: Connection) -> None:
    metadata.create_all(connection, SEALED)


MIGRATIONS: Final[tuple[Callable[[Connection], None], ...]] = (
    _first,
    _second,
    _third,
    _fourth,
    _fifth,
)
CURRENT: Final = len(MIGRATIONS)


def migrate(connection: Connection, *, now: int) -> None:
    """Bring the schema to this version, within the connection's transaction.

    Args:
        connection: With an open transaction that nobody else writes beside.
        now: UTC ns, for the record.

    Raises:
        StoreError: The store is of a later version.
    """
    standing = schema_version(connection)
    if standing > CURRENT:
        raise StoreError(
            f"the store has schema version {standing}, this program knows {CURRENT}; "
            "start the newer program, or another store"
        )
    for version in range(standing + 1, CURRENT + 1):
        MIGRATIONS[version - 1](connection)
        connection.execute(insert(versions).values(version=version, applied=now))


def schema_version(connection: Connection) -> int:
    """The version of the schema; 0 where there is none yet."""
    if not inspect(connection).has_table(versions.name):
        return 0
    return connection.execute(select(func.max(versions.c.version))).scalar_one() or 0
