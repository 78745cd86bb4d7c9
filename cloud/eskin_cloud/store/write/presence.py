"""Whether nodes are online, by their messages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import select

from eskin.privacy.sealed_message import MINUTE
from eskin.wire.messages import Position
from eskin.wire.messages.header import Kind
from eskin.wire.slot import key_of, slot_of
from eskin_cloud.store.row_digests import empty_row
from eskin_cloud.store.schema.tables import nodes
from eskin_cloud.store.write.events import event_row, store_event

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sqlalchemy import Connection

    from eskin.privacy import SealedMessage
    from eskin_cloud.store.feed_entry import FeedEntry
    from eskin_cloud.store.write.write_cache import Row, WriteCache

MOST_LAG: Final = 2**63 - 1
"""The greatest lag that a column holds, ns: 292 years."""


def mark_online(
    connection: Connection, cache: WriteCache, node: str, position: Position, *, now: int
) -> Row | None:
    """Record a node's message; returns an event's row if the node was offline."""
    row = cache.row(connection, nodes, *key_of(node))
    if row is None:
        cache.create(nodes, key_of(node), _new_node(node, position, now))
        return None
    was_online, last = row["online"], row["last_seen"]
    row["online"], row["last_seen"] = 1, now
    place = position.boot, position.sequence
    row["boot"], row["sequence"] = max((row["boot"], row["sequence"]), place)
    cache.change(nodes, *key_of(node))
    if was_online:
        return None
    return event_row(node, "status", position, (min(last, now), now), detail="online again")


def add_offline_node(
    connection: Connection, cache: WriteCache, node: str, place: tuple[int, int], *, now: int
) -> None:
    """Add a node that only a gateway knows, as offline."""
    if cache.row(connection, nodes, *key_of(node)) is None:
        cache.create(nodes, key_of(node), _new_node(node, Position(*place), now) | {"online": 0})


def record_layout(
    connection: Connection, cache: WriteCache, node: str, position: Position, layout: bytes
) -> None:
    """Record the layout of an online node's latest message.

    Args:
        connection: The writer's, in a transaction.
        cache: The writer's.
        node: The node.
        position: That of a message which `mark_online` has recorded.
        layout: Hash of the layout by which it is read.
    """
    row = cache.row(connection, nodes, *key_of(node))
    if row is None or row["layout"] == layout:
        return
    if row["layout"] is None or position >= (row["boot"], row["sequence"]):
        row["layout"] = layout
        cache.change(nodes, *key_of(node))


def record_lag(
    connection: Connection, cache: WriteCache, node: str, instant: tuple[int, int], *, now: int
) -> tuple[int, int]:
    """Record the lag of a node's latest frame.

    Args:
        connection: The writer's, in a transaction.
        cache: The writer's.
        node: The node.
        instant: Enclosure of its last sample's time, UTC ns.
        now: UTC ns.

    Returns:
        An enclosure of the lag, ns, at most `MOST_LAG`.
    """
    lag = _lag(now, instant)
    row = cache.row(connection, nodes, *key_of(node))
    if row is not None:
        row["lag_lo"], row["lag_hi"] = lag
        cache.change(nodes, *key_of(node))
    return lag


def record_sealed_lag(
    connection: Connection, cache: WriteCache, node: str, message: SealedMessage, *, now: int
) -> None:
    """Record a sealed frame's lag, by the minute, if no finer one is known.

    The lag of statements is not recorded, as it would show when a peak occurred.
    """
    row = cache.row(connection, nodes, *key_of(node))
    if row is None or message.kind is not Kind.FRAME:
        return
    if row["lag_lo"] is None or row["lag_hi"] - row["lag_lo"] >= MINUTE:
        row["lag_lo"], row["lag_hi"] = _lag(now, message.time)
        cache.change(nodes, *key_of(node))


def find_silent(connection: Connection, *, silent_since: int, now: int) -> list[str]:
    """The nodes that are online and silent, by name. Arguments are those of `is_silent`."""
    n = nodes.c
    query = select(n.node, n.last_seen).where(n.online == 1).order_by(n.node)
    return [
        node
        for node, last_seen in connection.execute(query)
        if is_silent(last_seen, silent_since=silent_since, now=now)
    ]


def is_silent(last_seen: int, *, silent_since: int, now: int) -> bool:
    """Whether a node is silent.

    Args:
        last_seen: When it was last seen, UTC ns. A time far in the future was written before the
            clock was set back; clocks of several clouds on one store differ somewhat.
        silent_since: Nodes last seen before it are silent, UTC ns.
        now: UTC ns.
    """
    return last_seen < silent_since or last_seen > now + (now - silent_since)


def mark_silent_offline(
    connection: Connection,
    cache: WriteCache,
    named: Iterable[str],
    *,
    silent_since: int,
    now: int,
) -> list[FeedEntry]:
    """Mark nodes as offline that are silent.

    Args:
        connection: The writer's, in a transaction.
        cache: The writer's.
        named: Nodes.
        silent_since: Nodes last seen before it, UTC ns, are offline.
        now: UTC ns.

    Returns:
        Entries for the live feed.
    """
    entries = []
    for node in named:
        row = cache.row(connection, nodes, *key_of(node))
        if row is None or not row["online"]:
            continue
        if not is_silent(row["last_seen"], silent_since=silent_since, now=now):
            continue
        row["online"] = 0
        cache.change(nodes, *key_of(node))
        position = Position(row["boot"], row["sequence"])
        event = event_row(
            node, "status", position, (min(row["last_seen"], now), now), detail="offline"
        )
        entries.append(store_event(connection, cache, event, now=now))
    return entries


def _lag(now: int, instant: tuple[int, int]) -> tuple[int, int]:
    return min(now - instant[1], MOST_LAG), min(now - instant[0], MOST_LAG)


def _new_node(node: str, position: Position, now: int) -> Row:
    place = {
        "slot": slot_of(node),
        "node": node,
        "boot": position.boot,
        "sequence": position.sequence,
    }
    return empty_row(nodes) | place | {"first_seen": now, "last_seen": now, "online": 1}
