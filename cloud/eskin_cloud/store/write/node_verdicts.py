"""Rows of the latest verdict that a node stated of each of its monitors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import orjson
from sqlalchemy import delete, insert, select, tuple_, update

from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.tables import node_verdicts

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from sqlalchemy import Connection, RowMapping

    from eskin_cloud.store.write.write_cache import Row

_STATED: Final = ("boot", "sequence", "verdict", "t_lo", "t_hi", "coverage", "detail")


def store_verdicts(connection: Connection, stated: Iterable[Row]) -> None:
    """Keep the last verdict of each monitor that a message states, unless a later one is known.

    Args:
        connection: The writer's, in a transaction.
        stated: Rows of the message's events, in the order in which it states them.
    """
    v = node_verdicts.c
    latest = {orjson.loads(row["detail"])["monitor"]: row for row in stated}
    for monitor, row in latest.items():
        here = of_node(node_verdicts, row["node"]) & (v.monitor == monitor)
        values = {name: row[name] for name in _STATED}
        known = connection.execute(select(v.boot, v.sequence).where(here)).one_or_none()
        if known is None:
            values |= {"node": row["node"], "monitor": monitor}
            connection.execute(insert(node_verdicts), values)
        elif tuple(known) < (row["boot"], row["sequence"]):
            connection.execute(update(node_verdicts).where(here).values(values))


def find_verdicts(connection: Connection, node: str) -> dict[str, RowMapping]:
    """A node's latest verdicts, by monitor; damaged rows are left out."""
    query = select(node_verdicts).where(of_node(node_verdicts, node))
    rows = intact_rows(connection, node_verdicts, connection.execute(query).mappings())
    return {row["monitor"]: row for row in rows}


def forget_verdicts(
    connection: Connection, node: str, names: Collection[str], before: tuple[int, int]
) -> None:
    """Forget what a node stated of some monitors before a message: they were defined anew."""
    if names:
        v = node_verdicts.c
        earlier = tuple_(v.boot, v.sequence) < tuple_(*before)
        connection.execute(
            delete(node_verdicts).where(of_node(node_verdicts, node), v.monitor.in_(names), earlier)
        )
