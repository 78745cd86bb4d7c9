"""The site of each node, from the certificate that a gateway presented.

It outlives the certificate and never changes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import delete, insert, select

from eskin_cloud.store.key_batches import key_batches
from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.schema.node_key import of_nodes
from eskin_cloud.store.schema.tables import node_sites

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from sqlalchemy import Connection


def sites_of(connection: Connection, nodes: Iterable[str]) -> dict[str, str]:
    """The sites of nodes; nodes without a site and damaged rows are left out."""
    found: dict[str, str] = {}
    query = select(node_sites)
    for batch in key_batches(list(nodes)):
        part = query.where(of_nodes(node_sites, batch))
        rows = intact_rows(connection, node_sites, connection.execute(part).mappings())
        found |= {row["node"]: row["site"] for row in rows}
    return found


def store_sites(
    connection: Connection,
    presented: Collection[tuple[str, bytes]],
    *,
    site: str,
    gateway: str,
    now: int,
) -> dict[str, str]:
    """Store the site of nodes whose certificates were verified.

    Args:
        connection: The writer's, in a transaction.
        presented: Nodes with their certificates (DER), which name the site.
        site: The site.
        gateway: The gateway that presented them.
        now: UTC ns.

    Returns:
        The stored site of each node; a node that had another site keeps it.
    """
    names = {node for node, _ in presented}
    standing = sites_of(connection, names)
    fresh = {node: data for node, data in presented if node not in standing}
    rows = [
        {"node": node, "site": site, "certificate": data, "gateway": gateway, "presented": now}
        for node, data in fresh.items()
    ]
    if rows:
        connection.execute(delete(node_sites).where(of_nodes(node_sites, fresh)))  # damaged rows
        connection.execute(insert(node_sites), rows)
    return standing | dict.fromkeys(fresh, site)
