"""Removing what is too old, and what is left of erased subjects: a little in each transaction.

The memory behind *once* (`sequences`) stays, so that a copy of what was removed is a duplicate
still. Sums over a channel's blocks go down; its hull stays, and encloses what remains.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from sqlalchemy import delete, func, insert, select, tuple_, update

from eskin_cloud.store.compacted_rows import part
from eskin_cloud.store.damage import DamagedRowError
from eskin_cloud.store.sample_grid import SampleGrid
from eskin_cloud.store.schema.sealed_tables import is_of_erased, removals, veiled
from eskin_cloud.store.schema.tables import blocks, channels, events
from eskin_cloud.store.write.bulk_insert import insert_many

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import ColumnElement, Connection, Table

    from eskin_cloud.store.write.write_cache import WriteCache


class Reason(StrEnum):
    """Why something is removed."""

    AGE = "age"
    ERASURE = "erasure"


@dataclass(frozen=True, slots=True)
class Sweep:
    """What is to be removed of a channel.

    Attributes:
        node: The node.
        channel: The channel.
        reason: Why.
        before: All that ended before it, UTC ns; of what is erased, all there is.
    """

    node: str
    channel: str
    reason: Reason
    before: int


def remove(connection: Connection, cache: WriteCache, sweep: Sweep, *, most: int, now: int) -> int:
    """Remove some of what a sweep is for; gives how many messages, fewer than ``most`` at its end.

    Packs go as a whole, so there may be some more.

    Args:
        connection: The writing thread's, in a transaction.
        cache: The writing thread's.
        sweep: What.
        most: At most so many.
        now: UTC ns.
    """
    gone = 0
    for table, where in _places(sweep):
        keys = list(table.primary_key.columns)
        query = select(*keys, *_counted(table)).where(*where).limit(most - gone)
        rows = connection.execute(query).all() if gone < most else []
        # Only then are few left to look through.
        if table is blocks and gone + len(rows) < most and _open_packs(connection, cache, sweep):
            rows = connection.execute(query).all()
        if rows:
            found = [tuple(row)[: len(keys)] for row in rows]
            connection.execute(delete(table).where(tuple_(*keys).in_(found)))
            _count(connection, cache, sweep, table, rows)
            gone += sum(map(_messages, rows))
    if gone:
        _explain(connection, sweep, gone, now)
    return gone


def sweeps_of_erased(connection: Connection) -> list[Sweep]:
    """What is left of erased subjects, by channel."""
    query = select(veiled.c.node, veiled.c.channel, func.max(veiled.c.t_hi))
    query = query.where(is_of_erased())
    rows = connection.execute(query.group_by(veiled.c.node, veiled.c.channel)).all()
    return [Sweep(row[0], row[1], Reason.ERASURE, row[2]) for row in rows]


def _places(sweep: Sweep) -> list[tuple[Table, list[ColumnElement[bool]]]]:
    sealed = [veiled.c.node == sweep.node, veiled.c.channel == sweep.channel]
    if sweep.reason is Reason.ERASURE:
        return [(veiled, [*sealed, is_of_erased()])]
    b, e, v = blocks.c, events.c, veiled.c
    here = [e.node == sweep.node, e.channel == sweep.channel]
    # That t or t_lo lies before is implied by what follows it; it is what indices are searched by.
    return [
        (
            blocks,
            [
                b.node == sweep.node,
                b.channel == sweep.channel,
                b.t < sweep.before,
                b.t_end + b.error < sweep.before,
            ],
        ),
        (events, [*here, e.t_lo < sweep.before, e.t_hi < sweep.before]),
        (veiled, [*sealed, v.t_lo < sweep.before, v.t_hi < sweep.before]),
        # Its own time may be far ahead, where the node's clock was: it goes by ours, too.
        (veiled, [*sealed, v.received < sweep.before]),
    ]


def _open_packs(connection: Connection, cache: WriteCache, sweep: Sweep) -> bool:
    """Put blocks in the place of packs of which a part is too old, so that it alone goes."""
    b = blocks.c
    here = [b.node == sweep.node, b.channel == sweep.channel, b.packed.is_not(None)]
    here += [b.t < sweep.before, b.t_end + b.error >= sweep.before]
    found = connection.execute(select(blocks).where(*here)).mappings().all()
    opened = False
    for row in found:
        try:
            parts = part(dict(row))
        except DamagedRowError:
            continue  # it goes as a whole, once all of it is too old
        opened = True
        key = [column == row[column.name] for column in blocks.primary_key.columns]
        connection.execute(delete(blocks).where(*key))
        insert_many(connection, blocks, parts)
        _grow(connection, cache, sweep, sum(len(each["data"]) for each in parts) - len(row["data"]))
    return opened


def _grow(connection: Connection, cache: WriteCache, sweep: Sweep, more: int) -> None:
    """Note that a channel's rows hold so many more bytes."""
    row = cache.row(connection, channels, sweep.node, sweep.channel)
    if row is not None:
        row["bytes"] += more
        cache.change(channels, sweep.node, sweep.channel)


def _messages(removed: Any) -> int:
    """How many messages a removed row was."""
    return getattr(removed, "packed", None) or 1


def _counted(table: Table) -> list[ColumnElement[Any]]:
    """What of a removed row counts in its channel's sums."""
    if table is blocks:
        size = func.length(table.c.data).label("size")
        return [size, table.c.packed, table.c.t, table.c.dt, table.c.n]
    return [table.c.kind] if table is veiled else []


def _count(
    connection: Connection, cache: WriteCache, sweep: Sweep, table: Table, rows: Sequence[Any]
) -> None:
    row = cache.row(connection, channels, sweep.node, sweep.channel)
    if row is None or table is events:
        return
    here = (table.c.node == sweep.node) & (table.c.channel == sweep.channel)
    if table is blocks:
        row["blocks"] -= sum(map(_messages, rows))
        row["samples"] -= sum(removed.n for removed in rows)
        row["bytes"] -= sum(removed.size for removed in rows)
        if row["built"] is not None:
            for removed in rows:
                t, dt, n = removed[-3:]
                cache.outdate(row, SampleGrid(t, dt, n, _messages(removed)))
        first = select(func.min(blocks.c.t)).where(here)
    else:
        row["blocks"] -= sum(removed.kind == "block" for removed in rows)
        first = select(func.min(veiled.c.t_lo)).where(here)
    row["t_first"] = connection.execute(first).scalar_one()
    if row["t_first"] is None:
        row |= {"t_last": None, "lo": None, "hi": None}
    cache.change(channels, sweep.node, sweep.channel)


def _explain(connection: Connection, sweep: Sweep, gone: int, now: int) -> None:
    r = removals.c
    here = (r.node == sweep.node) & (r.channel == sweep.channel) & (r.reason == sweep.reason)
    told = {"messages": r.messages + gone, "before": sweep.before, "at": now}
    if connection.execute(update(removals).where(here).values(told)).rowcount == 0:
        key = {"node": sweep.node, "channel": sweep.channel, "reason": sweep.reason.value}
        row = key | {"messages": gone, "before": sweep.before, "at": now}
        connection.execute(insert(removals), row)
