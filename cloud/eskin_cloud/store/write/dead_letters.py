"""What was refused is kept with its reason, so that nothing vanishes silently."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import delete, func, insert, select, tuple_

from eskin_cloud.store.schema.tables import dead_letters

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from eskin_cloud.store.write.write_cache import Row


def keep(connection: Connection, letters: Sequence[Row], *, most: int) -> int:
    """Keep dead letters; the same bytes of the same node once, and at most so many.

    Returns:
        How many old ones had to go.
    """
    key = tuple_(dead_letters.c.node, dead_letters.c.digest)
    for letter in letters:
        here = key == tuple_(letter["node"], letter["digest"])
        if connection.execute(select(dead_letters.c.node).where(here)).first() is None:
            connection.execute(insert(dead_letters), letter)
    excess = count(connection) - most
    if excess <= 0:
        return 0
    oldest = select(dead_letters.c.node, dead_letters.c.digest)
    oldest = oldest.order_by(dead_letters.c.received, dead_letters.c.digest).limit(excess)
    connection.execute(delete(dead_letters).where(key.in_(oldest)))
    return excess


def count(connection: Connection) -> int:
    """How many there are."""
    return connection.execute(select(func.count()).select_from(dead_letters)).scalar_one()
