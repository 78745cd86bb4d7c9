"""To which site each node belongs, as its certificate says, which a gateway presented once.

The pair does not end with the certificate, and never changes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import BigInteger, Column, LargeBinary, Table, delete, insert, select

from eskin_cloud.store.row_digests import keep_checked, sound
from eskin_cloud.store.schema.tables import NODE_LENGTH, metadata
from eskin_cloud.store.schema.text_type import Text

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from sqlalchemy import Connection

SITE_LENGTH: Final = NODE_LENGTH + 5
_MOST_ASKED: Final = 4000

node_sites: Final = Table(
    "node_sites",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("site", Text(SITE_LENGTH), nullable=False),
    Column("certificate", LargeBinary, nullable=False),
    Column("gateway", Text(NODE_LENGTH + 9), nullable=False),
    Column("presented", BigInteger, nullable=False),
)
"""Each node with its site; ``certificate`` (DER) is the one that ``gateway`` presented."""
keep_checked(node_sites)


def sites_of(connection: Connection, nodes: Iterable[str]) -> dict[str, str]:
    """The sites of some nodes; without those that no certificate told, and damaged rows."""
    asked = list(nodes)
    found: dict[str, str] = {}
    query = select(node_sites)
    for begin in range(0, len(asked), _MOST_ASKED):
        part = query.where(node_sites.c.node.in_(asked[begin : begin + _MOST_ASKED]))
        rows = sound(connection, node_sites, connection.execute(part).mappings())
        found |= {row["node"]: row["site"] for row in rows}
    return found


def nodes_of(connection: Connection, site: str) -> set[str]:
    """The nodes of a site."""
    query = select(node_sites.c.node).where(node_sites.c.site == site)
    return set(connection.execute(query).scalars())


def keep_sites(
    connection: Connection,
    presented: Collection[tuple[str, bytes]],
    *,
    site: str,
    gateway: str,
    now: int,
) -> dict[str, str]:
    """Keep the site of nodes whose certificates were verified, within a transaction.

    Args:
        connection: The writing thread's.
        presented: Nodes with their certificates (DER), which name the site.
        site: The site.
        gateway: Who presented them.
        now: UTC ns.

    Returns:
        The site of each of these nodes, which is another one where it was presented for another.
    """
    names = {node for node, _ in presented}
    standing = sites_of(connection, names)
    fresh = {node: data for node, data in presented if node not in standing}
    rows = [
        {"node": node, "site": site, "certificate": data, "gateway": gateway, "presented": now}
        for node, data in fresh.items()
    ]
    if rows:
        connection.execute(delete(node_sites).where(node_sites.c.node.in_(fresh)))  # if damaged
        connection.execute(insert(node_sites), rows)
    return standing | dict.fromkeys(fresh, site)
