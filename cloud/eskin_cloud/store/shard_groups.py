"""Groups of slots that one transaction may write: on Citus, those of one shard."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import text

from eskin_cloud.store.slot import SLOTS

if TYPE_CHECKING:
    from sqlalchemy import Connection

_IS_DISTRIBUTED: Final = text(
    "SELECT EXISTS (SELECT FROM pg_dist_partition"
    " WHERE logicalrelid = 'feed'::regclass AND partmethod = 'h')"
)
_HAS_CITUS: Final = text("SELECT EXISTS (SELECT FROM pg_extension WHERE extname = 'citus')")
_SHARDS: Final = text(
    "SELECT slot, get_shard_id_for_distribution_column('feed', slot) AS shard"
    " FROM generate_series(0, :last) AS slot ORDER BY slot"
)


def is_distributed(connection: Connection) -> bool:
    """Whether a store's tables of nodes are distributed by Citus."""
    if connection.dialect.name != "postgresql" or not connection.scalar(_HAS_CITUS):
        return False
    return bool(connection.scalar(_IS_DISTRIBUTED))


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
