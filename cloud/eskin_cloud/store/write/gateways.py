"""Rows of gateways: last contact, counts of messages, reported status."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sqlalchemy import insert, select, update

from eskin_cloud.store.row_digests import intact_rows, without_digest
from eskin_cloud.store.schema.tables import gateways

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin_cloud.store.write.ingest import IngestResult

_COUNTED: Final = ("stored", "duplicate", "rejected")


class GatewayStatus(NamedTuple):
    """A gateway's report of its own status.

    Attributes:
        messages: Messages in its spool.
        used: Their bytes.
        capacity: Most bytes.
        oldest: For how long the oldest has waited, ns; ``None`` where none waits.
        dead_letters: Messages that it could not use.
        nodes: How many nodes it receives messages of.
    """

    messages: int
    used: int
    capacity: int
    oldest: int | None
    dead_letters: int
    nodes: int


@dataclass(slots=True)
class ContactCounts:
    """What a gateway's batches came to.

    Attributes:
        results: How many messages had each result.
        lag: Enclosure of the lag of the latest frame, ns.
    """

    results: Counter[str] = field(default_factory=Counter)
    lag: tuple[int, int] | None = None

    def add(self, outcome: IngestResult) -> None:
        """Add a batch."""
        results = (receipt.result for receipt in outcome.results)
        self.results.update(result for result in results if result in _COUNTED)
        self.lag = outcome.lag or self.lag


def record_contact(
    connection: Connection,
    gateway: str,
    *,
    site: str,
    condition: GatewayStatus | None,
    now: int,
    wait: int = 0,
    counts: ContactCounts | None = None,
) -> None:
    """Record a gateway's contact.

    Args:
        connection: The writer's, in a transaction.
        gateway: Its name.
        site: Its site.
        condition: Its reported status, if any.
        now: UTC ns.
        wait: How long its request may wait, ns.
        counts: What its batches came to, if it sent any.
    """
    values: dict[str, Any] = {"last_heard": now}
    results: dict[str, int] = {}
    if condition is not None:
        values |= {"reported": now, **condition._asdict()}
    if counts is None:
        values["due"] = now + wait
    else:
        results |= counts.results
        if counts.lag is not None:
            values |= {"latest": now, "lag_lo": counts.lag[0], "lag_hi": counts.lag[1]}
    g = gateways.c
    added = {name: g[name] + count for name, count in results.items()}
    changed = update(gateways).where(g.gateway == gateway).values(**values, **added)
    if connection.execute(changed).rowcount:
        return
    fresh = {"gateway": gateway, "site": site, "first_heard": now, "due": now}
    fresh |= dict.fromkeys(_COUNTED, 0)
    connection.execute(insert(gateways).values(**fresh | values | results))


def list_gateways(connection: Connection) -> list[dict[str, Any]]:
    """All gateways, by name."""
    query = select(gateways).order_by(gateways.c.gateway)
    rows = connection.execute(query).mappings()
    return [without_digest(row) for row in intact_rows(connection, gateways, rows)]
