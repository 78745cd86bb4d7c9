"""Groups of slots that one transaction may write: on Citus, those of one shard."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import text

from eskin.wire.slot import SLOTS

if TYPE_CHECKING:
    from sqlalchemy import Connection, Engine

_IS_DISTRIBUTED: Final = text(
    "SELECT EXISTS (SELECT FROM pg_dist_partition"
    " WHERE logicalrelid = 'feed'::regclass AND partmethod = 'h')"
)
_HAS_CITUS: Final = text("SELECT EXISTS (SELECT FROM pg_extension WHERE extname = 'citus')")
_SHARDS: Final = text(
    "SELECT slot, get_shard_id_for_distribution_column('feed', slot) AS shard"
    " FROM generate_series(0, :last) AS slot ORDER BY slot"
)

_HOLD: Final = text("UPDATE feed SET cursor = cursor WHERE slot = :held AND cursor < 0")
"""Writes no row: what counts is Citus's lock of the shard, which it has for a write only."""
_PLACES: Final = text(
    "SELECT string_agg(p.shardid || '@' || p.groupid || '/' || p.xmin, ' ' ORDER BY p.shardid)"
    " FROM pg_dist_shard AS s JOIN pg_dist_placement AS p USING (shardid)"
    " WHERE s.logicalrelid = 'feed'::regclass"
)
"""Of one table: the shards of all tables with the same slots move together. The transaction that
wrote a place (``xmin``) reveals a shard that moved there and back."""
_DISTRIBUTED: Final = "distributed"
"""Key in ``Connection.info``."""


def is_distributed(connection: Connection) -> bool:
    """Whether a store's tables of nodes are distributed by Citus."""
    if connection.dialect.name != "postgresql" or not connection.scalar(_HAS_CITUS):
        return False
    return bool(connection.scalar(_IS_DISTRIBUTED))


def session_is_distributed(connection: Connection) -> bool:
    """Whether the database is distributed; asked once a session."""
    if _DISTRIBUTED not in connection.info:
        connection.info[_DISTRIBUTED] = is_distributed(connection)
    known: bool = connection.info[_DISTRIBUTED]
    return known


def hold_shard(connection: Connection, slot: int) -> None:
    """Keep the shard of a slot where it is until the transaction ends; nothing without Citus.

    The lock of a row is of one server: a shard that is moved or split leaves it behind, and the
    next writer would have the row at once. A write locks the shard against both, and a query for
    rows to lock does not. `feed` is the first table that is distributed, so Citus locks its shards
    first, too, and a transaction that begins here waits for a move with no lock that it needs.

    Args:
        connection: At the beginning of a transaction.
        slot: One of those that the transaction writes.
    """
    if session_is_distributed(connection):
        connection.execute(_HOLD, {"held": slot})


def shard_places(connection: Connection) -> str | None:
    """Which server each shard is at; ``None`` without Citus.

    A transaction under REPEATABLE READ has a state of each server, from when it first asked there.
    Rows of a shard that moved to a server after that are in no result, as if they had never been
    stored. So a caller compares the places before and after.
    """
    if not session_is_distributed(connection):
        return None
    places: str = connection.execute(_PLACES).scalar_one()
    return places


def shard_places_now(reading: Engine) -> str | None:
    """Which server each shard is at by now, whatever transactions are open."""
    with reading.connect() as connection:
        return shard_places(connection.execution_options(isolation_level="AUTOCOMMIT"))


def read_groups(connection: Connection) -> list[frozenset[int]]:
    """The slots of each shard, by their lowest slot; one group of all slots without Citus.

    Citus refuses a statement that locks rows of two shards, and a transaction that writes two
    servers takes two phases to commit. Another server for a shard changes no group; a split shard
    does, so a caller reads them again after a statement that failed.

    Args:
        connection: To a store; on Citus, to its coordinator.
    """
    if not is_distributed(connection):
        return [frozenset(range(SLOTS))]
    found: dict[int, set[int]] = {}
    for slot, shard in connection.execute(_SHARDS, {"last": SLOTS - 1}):
        found.setdefault(shard, set()).add(slot)
    return [frozenset(slots) for slots in found.values()]
