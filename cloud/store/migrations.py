"""Migrations, in order; each and its record share one transaction.

They are the same for SQLite and PostgreSQL. Whoever migrates holds the store's write lock, so that
of several that start at once one does it, and the others find it done.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import Connection, func, insert, inspect, select, text, update

from cloud.store.clock import Reading, clock, keep_reading
from cloud.store.events import ENERGY
from cloud.store.gateways import gateways
from cloud.store.grid import grain_of
from cloud.store.schema import (
    audit_log,
    blocks,
    channels,
    commands,
    feed,
    metadata,
    nodes,
    states,
    versions,
    warrants,
)
from cloud.store.sealed import erased_subjects, removals, veiled, wearers
from cloud.store.tiles import stale, tiles
from eskin.errors import StoreError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from sqlalchemy import Table


SEALED: Final = [veiled, erased_subjects, wearers, removals]
PYRAMID: Final = [tiles, stale]


def _first(connection: Connection) -> None:
    later = {commands, states, audit_log, warrants, gateways, *SEALED, *PYRAMID, clock}
    metadata.create_all(connection, [t for t in metadata.sorted_tables if t not in later])
    connection.execute(insert(feed).values(name="feed", cursor=0))


def _second(connection: Connection) -> None:
    metadata.create_all(connection, [commands, states])


def _third(connection: Connection) -> None:
    metadata.create_all(connection, [audit_log])


def _fourth(connection: Connection) -> None:
    _add_columns(connection, nodes, ENERGY)


def _fifth(connection: Connection) -> None:
    _add_columns(connection, nodes, ("faults", "places"))


def _sixth(connection: Connection) -> None:
    _add_columns(connection, feed, ("writer",))


def _seventh(connection: Connection) -> None:
    metadata.create_all(connection, [warrants])


def _add_columns(connection: Connection, table: Table, names: Iterable[str]) -> None:
    """Add columns where they are not there: the first migration makes tables as they are today."""
    standing = {column["name"] for column in inspect(connection).get_columns(table.name)}
    for name in names:
        if name not in standing:
            kind = table.c[name].type.compile(connection.dialect)
            connection.execute(text(f"ALTER TABLE {table.name} ADD COLUMN {name} {kind}"))


def _eighth(connection: Connection) -> None:
    metadata.create_all(connection, SEALED)


def _ninth(connection: Connection) -> None:
    metadata.create_all(connection, PYRAMID)
    _add_columns(connection, channels, ("grain", "built"))
    c = channels.c
    for (dt,) in connection.execute(select(c.dt).distinct().where(c.blocks > 0)).all():
        where = (c.dt == dt) & (c.blocks > 0)
        connection.execute(update(channels).where(where).values(grain=grain_of(dt)))


def _tenth(connection: Connection) -> None:
    """Keep a block in its row, as it is: PostgreSQL would cut and try to compress it elsewhere."""
    if connection.dialect.name == "postgresql":
        for name in (blocks.name, veiled.name):
            connection.execute(text(f"ALTER TABLE {name} ALTER COLUMN data SET STORAGE EXTERNAL"))
            connection.execute(text(f"ALTER TABLE {name} SET (toast_tuple_target = 8160)"))


def _eleventh(connection: Connection) -> None:
    """Rows may hold packs from now on, which earlier programs cannot read."""
    _add_columns(connection, blocks, ("packed",))
    _add_columns(connection, channels, ("packed",))


def _twelfth(connection: Connection) -> None:
    metadata.create_all(connection, [gateways])
    _add_columns(connection, nodes, ("lag_lo", "lag_hi"))


def _thirteenth(connection: Connection) -> None:
    """Count the bytes of each channel, once; from then on they are kept."""
    _add_columns(connection, channels, ("bytes",))
    connection.execute(update(channels).values(bytes=0))
    here = (blocks.c.node, blocks.c.channel)
    query = select(*here, func.sum(func.length(blocks.c.data))).group_by(*here)
    for node, channel, size in connection.execute(query).all():
        where = (channels.c.node == node) & (channels.c.channel == channel)
        connection.execute(update(channels).where(where).values(bytes=int(size)))


def _fourteenth(connection: Connection) -> None:
    """Know what time it is at least: that at which a node was heard last."""
    metadata.create_all(connection, [clock])
    heard = connection.execute(select(func.max(nodes.c.last_seen))).scalar_one()
    if heard is not None:
        keep_reading(connection, Reading(heard))


def _fifteenth(_: Connection) -> None:
    """Blocks may be compressed from now on, which earlier programs cannot read."""


MIGRATIONS: Final[tuple[Callable[[Connection], None], ...]] = (
    *(_first, _second, _third, _fourth, _fifth, _sixth, _seventh, _eighth, _ninth, _tenth),
    *(_eleventh, _twelfth, _thirteenth, _fourteenth, _fifteenth),
)
CURRENT: Final = len(MIGRATIONS)
_STANDING: Final = select(func.max(versions.c.version))


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
        raise _later(standing)
    for version in range(standing + 1, CURRENT + 1):
        MIGRATIONS[version - 1](connection)
        connection.execute(insert(versions).values(version=version, applied=now))


def schema_version(connection: Connection) -> int:
    """The version of the schema; 0 where there is none yet."""
    if not inspect(connection).has_table(versions.name):
        return 0
    return connection.execute(_STANDING).scalar_one() or 0


def require_current(connection: Connection) -> None:
    """Check that the schema is the one that this program knows.

    Raises:
        StoreError: It is another one.
    """
    standing = connection.execute(_STANDING).scalar_one() or 0
    if standing > CURRENT:
        raise _later(standing)
    if standing < CURRENT:
        raise StoreError(
            f"the store has schema version {standing}, this program needs {CURRENT}; "
            "start it again, so that it migrates"
        )


def _later(version: int) -> StoreError:
    """The refusal of a store of a later version."""
    return StoreError(
        f"the store has schema version {version}, this program knows {CURRENT}; "
        "start the newer program, or another store"
    )
