"""What is known of each gateway: when it was heard, what it brought, what it tells of itself."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sqlalchemy import BigInteger, Column, Table, insert, select, update

from eskin_cloud.store.row_digests import keep_checked, sound, without_digest
from eskin_cloud.store.schema.tables import NODE_LENGTH, metadata
from eskin_cloud.store.schema.text_type import Text
from eskin_cloud.store.write.node_sites import SITE_LENGTH

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin_cloud.store.write.ingest import IngestResult

gateways: Final = Table(
    "gateways",
    metadata,
    Column("gateway", Text(NODE_LENGTH + 9), primary_key=True),
    Column("site", Text(SITE_LENGTH), nullable=False),
    Column("first_heard", BigInteger, nullable=False),
    Column("last_heard", BigInteger, nullable=False),
    Column("due", BigInteger, nullable=False),
    Column("told", BigInteger),
    Column("messages", BigInteger),
    Column("used", BigInteger),
    Column("capacity", BigInteger),
    Column("oldest", BigInteger),
    Column("dead_letters", BigInteger),
    Column("nodes", BigInteger),
    Column("stored", BigInteger, nullable=False),
    Column("duplicate", BigInteger, nullable=False),
    Column("rejected", BigInteger, nullable=False),
    Column("latest", BigInteger),
    Column("lag_lo", BigInteger),
    Column("lag_hi", BigInteger),
)
"""Each gateway that ever proved who it is.

``due`` is up to when it may be silent, since it waits for an answer; ``told`` is when it told of
itself last, ``oldest`` for how long its oldest message had waited then. ``latest`` is when its
latest block was stored, and ``lag_lo`` to ``lag_hi`` how long after that block's last sample.
"""
keep_checked(gateways)
_COUNTED: Final = ("stored", "duplicate", "rejected")


class GatewayStatus(NamedTuple):
    """A gateway's report of its own status.

    Attributes:
        messages: Messages in its spool.
        used: Their bytes.
        capacity: Most bytes.
        oldest: For how long the oldest has waited, ns; ``None`` where none waits.
        dead_letters: Messages that it could not use.
        nodes: How many nodes it hears.
    """

    messages: int
    used: int
    capacity: int
    oldest: int | None
    dead_letters: int
    nodes: int


def hear(
    connection: Connection,
    gateway: str,
    *,
    site: str,
    condition: GatewayStatus | None,
    now: int,
    wait: int = 0,
    outcome: IngestResult | None = None,
) -> None:
    """Note that a gateway was heard.

    Args:
        connection: The writing thread's, in a transaction.
        gateway: Its name.
        site: Its site.
        condition: The status that it reported, if any.
        now: UTC ns.
        wait: For how long it waits now, ns.
        outcome: What became of the batch that it brought, if it did.
    """
    values: dict[str, Any] = {"last_heard": now}
    if outcome is None:
        values["due"] = now + wait
    if condition is not None:
        values |= {"told": now, **condition._asdict()}
    counts: Counter[str] = Counter()
    if outcome is not None:
        results = (receipt.result for receipt in outcome.results)
        counts.update(result for result in results if result in _COUNTED)
        if outcome.lag is not None:
            values |= {"latest": now, "lag_lo": outcome.lag[0], "lag_hi": outcome.lag[1]}
    g = gateways.c
    added = {name: g[name] + count for name, count in counts.items()}
    changed = update(gateways).where(g.gateway == gateway).values(**values, **added)
    if connection.execute(changed).rowcount:
        return
    fresh = {"gateway": gateway, "site": site, "first_heard": now, "due": now}
    fresh |= dict.fromkeys(_COUNTED, 0)
    connection.execute(insert(gateways).values(**fresh | values | counts))


def list_gateways(connection: Connection) -> list[dict[str, Any]]:
    """All gateways, by name; they are few."""
    query = select(gateways).order_by(gateways.c.gateway)
    rows = connection.execute(query).mappings()
    return [without_digest(row) for row in sound(connection, gateways, rows)]
