"""Whether nodes are there: seen by their messages, given up by their silence."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import insert, select

from eskin.privacy.sealed_message import MINUTE
from eskin.wire.messages import Position
from eskin.wire.messages.header import Kind
from eskin_cloud.store.feed_entry import FeedEntry
from eskin_cloud.store.schema.tables import events, nodes
from eskin_cloud.store.write.events import event_row

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from eskin.privacy import SealedMessage
    from eskin_cloud.store.write.block_row import BlockRow
    from eskin_cloud.store.write.write_cache import Row, WriteCache

MOST_LAG: Final = 2**63 - 1
"""What the store can hold, ns: 292 years. A node's times lie as far back as its clock does."""


def see(
    connection: Connection, cache: WriteCache, node: str, position: Position, *, now: int
) -> Row | None:
    """Note that a node spoke; gives an event's row when it had been offline."""
    row = cache.row(connection, nodes, node)
    if row is None:
        cache.create(nodes, (node,), _fresh(node, position, now))
        return None
    was_online, last = row["online"], row["last_seen"]
    row["online"], row["last_seen"] = 1, now
    place = position.boot, position.sequence
    row["boot"], row["sequence"] = max((row["boot"], row["sequence"]), place)
    cache.change(nodes, node)
    if was_online:
        return None
    return event_row(node, "status", position, (min(last, now), now), detail="online again")


def note_absent(
    connection: Connection, cache: WriteCache, node: str, place: tuple[int, int], *, now: int
) -> None:
    """Note a node that this store does not know, though another one knew it: it is offline."""
    if cache.row(connection, nodes, node) is None:
        cache.create(nodes, (node,), _fresh(node, Position(*place), now) | {"online": 0})


def note_blocks(
    connection: Connection, cache: WriteCache, rows: Sequence[BlockRow], *, now: int
) -> tuple[int, int]:
    """Note where a node is, and how long after the last block's last sample that was stored.

    Args:
        connection: The writing thread's, in a transaction.
        cache: The writing thread's.
        rows: Rows of blocks of one boot of a node that was seen, in the order they came.
        now: UTC ns.

    Returns:
        The lag: an enclosure, ns; `MOST_LAG` stands for more, too.
    """
    last = rows[-1]
    lag = _lag(now - (last.t_end - last.t), (last.t_lo, last.t_hi))
    row = cache.row(connection, nodes, last.node)
    if row is not None:
        place = last.boot, max(each.sequence for each in rows)
        row["boot"], row["sequence"] = max((row["boot"], row["sequence"]), place)
        row["lag_lo"], row["lag_hi"] = lag
        cache.change(nodes, last.node)
    return lag


def note_veiled_lag(
    connection: Connection, cache: WriteCache, node: str, message: SealedMessage, *, now: int
) -> None:
    """Note a sealed block's lag, as wide as the minutes that it tells, where no other one is known.

    Not that of a peak: it would tell everybody when that came. What a block in the clear told stays
    until another such block comes.
    """
    row = cache.row(connection, nodes, node)
    if row is None or message.kind is not Kind.BLOCK:
        return
    if row["lag_lo"] is None or row["lag_hi"] - row["lag_lo"] >= MINUTE:
        row["lag_lo"], row["lag_hi"] = _lag(now, message.time)
        cache.change(nodes, node)


def give_up(
    connection: Connection, cache: WriteCache, *, silent_since: int, now: int
) -> list[FeedEntry]:
    """Note which nodes fell silent.

    Args:
        connection: The writing thread's, in a transaction.
        cache: The writing thread's.
        silent_since: UTC ns; nodes last seen before are offline.
        now: UTC ns.

    Returns:
        News for the live feed.
    """
    # A last_seen that lies far ahead comes from before the clock was set back: it says nothing.
    # Clocks of several clouds on one store differ somewhat.
    ahead = nodes.c.last_seen > now + (now - silent_since)
    gone = (nodes.c.last_seen < silent_since) | ahead
    silent = select(nodes.c.node).where(nodes.c.online == 1, gone)
    entries = []
    for node in connection.execute(silent.order_by(nodes.c.node)).scalars().all():
        row = cache.row(connection, nodes, node)
        if row is None:
            continue
        row["online"] = 0
        cache.change(nodes, node)
        position = Position(row["boot"], row["sequence"])
        event = event_row(
            node, "status", position, (min(row["last_seen"], now), now), detail="offline"
        )
        cursor = cache.next_cursor(connection)
        event |= {"cursor": cursor, "received": now}
        connection.execute(insert(events), event)
        entries.append(FeedEntry(cursor, node, None, None, event, now))
    return entries


def _lag(now: int, moment: tuple[int, int]) -> tuple[int, int]:
    return min(now - moment[1], MOST_LAG), min(now - moment[0], MOST_LAG)


def _fresh(node: str, position: Position, now: int) -> Row:
    return {
        "node": node,
        "first_seen": now,
        "last_seen": now,
        "online": 1,
        "boot": position.boot,
        "sequence": position.sequence,
    } | dict.fromkeys(column.name for column in nodes.columns if column.nullable)
