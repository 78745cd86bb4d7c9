"""Remove old messages and those of erased subjects, a few in each transaction.

`sequences` stay, so that a copy of a removed message is still a duplicate. A channel's totals
decrease; its hull stays, and encloses what remains.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from sqlalchemy import and_, delete, func, insert, select, tuple_, update

from eskin.privacy.sealed_message import read_page
from eskin_cloud.store.compacted_rows import split_blocks
from eskin_cloud.store.damage import DamagedRowError
from eskin_cloud.store.patch_totals import Place, subtract_rows
from eskin_cloud.store.sample_grid import SampleGrid
from eskin_cloud.store.schema.frame_tables import frames, pages, patch_rows
from eskin_cloud.store.schema.sealed_tables import is_of_erased_subject, removals, sealed_messages
from eskin_cloud.store.schema.tables import blocks, channels, events
from eskin_cloud.store.slot import slot_of
from eskin_cloud.store.write.bulk_insert import insert_many

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import ColumnElement, Connection, Table

    from eskin_cloud.store.write.write_cache import WriteCache


class RemovalReason(StrEnum):
    """Reasons of removal."""

    AGE = "age"
    ERASURE = "erasure"


@dataclass(frozen=True, slots=True)
class Sweep:
    """What to remove of a channel.

    Attributes:
        node: The node.
        channel: The channel; of sealed frames and statements the place, as its row names it.
        reason: Why.
        before: Messages that ended before it are removed, UTC ns; of erased subjects, all are.
    """

    node: str
    channel: str
    reason: RemovalReason
    before: int


def remove(connection: Connection, cache: WriteCache, sweep: Sweep, *, most: int, now: int) -> int:
    """Remove some messages of a sweep; returns their number, below ``most`` at the end.

    A pack is removed as a whole, so the number may exceed ``most``.

    Args:
        connection: The writer's, in a transaction.
        cache: The writer's.
        sweep: What to remove.
        most: Limit of messages.
        now: UTC ns.
    """
    gone = 0
    for table, where in _places(sweep):
        keys = list(table.primary_key.columns)
        query = select(*keys, *_counted(table)).where(*where).limit(most - gone)
        rows = connection.execute(query).all() if gone < most else []
        # Few are left to search then.
        if table is blocks and gone + len(rows) < most and _split_packs(connection, cache, sweep):
            rows = connection.execute(query).all()
        if rows:
            found = [tuple(row)[: len(keys)] for row in rows]
            connection.execute(delete(table).where(tuple_(*keys).in_(found)))
            _update_totals(connection, cache, sweep, table, rows)
            gone += sum(map(_messages, rows))
    if gone:
        _record_removal(connection, sweep, gone, now)
    return gone


@dataclass(frozen=True, slots=True)
class PatchSweep:
    """What to remove of a patch, because of its age.

    Attributes:
        node: The node.
        patch: The patch.
        channels: Its channels, whose events are removed, too.
        before: Rows that ended before it are removed, UTC ns.
    """

    node: str
    patch: str
    channels: tuple[str, ...]
    before: int


def remove_rows(connection: Connection, sweep: PatchSweep, *, most: int, now: int) -> int:
    """Remove some compacted rows and events of a patch; returns the number of messages.

    It is below ``most`` at the end. A row is removed as a whole, so it may exceed ``most``.

    Args:
        connection: The writer's, in a transaction.
        sweep: What to remove.
        most: Limit of messages.
        now: UTC ns.
    """
    place, r, e = Place(sweep.node, sweep.patch), patch_rows.c, events.c
    columns = (r.t, r.boot, r.sequence, r.t_end, r.samples, r.frames)
    query = select(*columns, func.length(r.data).label("size")).where(place.within(patch_rows))
    query = query.where(r.t < sweep.before, r.t_end + r.error < sweep.before)
    rows, gone = [], 0
    for row in connection.execute(query.order_by(r.t).limit(most)).mappings().all():
        if gone >= most:
            break
        rows.append(row)
        gone += row["frames"]
    if rows:
        keys = [(row["t"], row["boot"], row["sequence"]) for row in rows]
        these = tuple_(r.t, r.boot, r.sequence).in_(keys)
        connection.execute(delete(patch_rows).where(place.within(patch_rows), these))
        subtract_rows(connection, place, rows)
    if gone < most:
        old = select(e.cursor).where(e.node == sweep.node, e.channel.in_(sweep.channels))
        old = old.where(e.t_lo < sweep.before, e.t_hi < sweep.before).limit(most - gone)
        cursors = connection.execute(old).scalars().all()
        if cursors:
            here = (e.node == sweep.node) & e.cursor.in_(cursors)
            gone += connection.execute(delete(events).where(here)).rowcount
    if gone:
        as_channel = Sweep(sweep.node, sweep.patch, RemovalReason.AGE, sweep.before)
        _record_removal(connection, as_channel, gone, now)
    return gone


def remove_damaged_frames(
    connection: Connection, cache: WriteCache, page: tuple[int, str, bytes, int], before: int
) -> int:
    """Remove frames that could not be compacted; returns their number.

    Args:
        connection: The writer's, in a transaction.
        cache: The writer's.
        page: Slot, node, layout and number of the page.
        before: Those that ended before it are removed, UTC ns; the page is compacted up to it.
    """
    f, row = frames.c, cache.row(connection, pages, *page)
    if row is None or row["compacted"] is None:
        return 0
    here = and_(f.slot == page[0], f.node == page[1], f.page == page[3], f.layout == page[2])
    old = here & (f.t < min(before, row["compacted"])) & (f.t_end + f.error < before)
    counted = select(func.count(), func.sum(f.samples), func.sum(func.length(f.data))).where(old)
    count, samples, size = connection.execute(counted).one()
    if count:
        connection.execute(delete(frames).where(old))
        row["frames"] -= count
        row["samples"] -= samples
        row["bytes"] -= size
        row["t_first"] = connection.execute(select(func.min(f.t)).where(here)).scalar_one()
        if row["t_first"] is None:
            row["t_last"] = None
        cache.change(pages, *page)
    return int(count)


def sweeps_of_erased(connection: Connection) -> list[Sweep]:
    """The remaining messages of erased subjects, by channel."""
    query = select(
        sealed_messages.c.node, sealed_messages.c.place, func.max(sealed_messages.c.t_hi)
    )
    query = query.where(is_of_erased_subject())
    rows = connection.execute(query.group_by(sealed_messages.c.node, sealed_messages.c.place)).all()
    return [Sweep(row[0], row[1], RemovalReason.ERASURE, row[2]) for row in rows]


def _places(sweep: Sweep) -> list[tuple[Table, list[ColumnElement[bool]]]]:
    sealed = [sealed_messages.c.node == sweep.node, sealed_messages.c.place == sweep.channel]
    if sweep.reason is RemovalReason.ERASURE:
        return [(sealed_messages, [*sealed, is_of_erased_subject()])]
    b, e, v = blocks.c, events.c, sealed_messages.c
    here = [e.node == sweep.node, e.channel == sweep.channel]
    # The conditions on t and t_lo are implied by the following ones, but let indexes be used.
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
        (sealed_messages, [*sealed, v.t_lo < sweep.before, v.t_hi < sweep.before]),
        # The message's own time may be far ahead, if the node's clock was: use the cloud's, too.
        (sealed_messages, [*sealed, v.received < sweep.before]),
    ]


def _split_packs(connection: Connection, cache: WriteCache, sweep: Sweep) -> bool:
    """Replace packs that are partly too old by their blocks."""
    b = blocks.c
    here = [b.node == sweep.node, b.channel == sweep.channel, b.packed.is_not(None)]
    here += [b.t < sweep.before, b.t_end + b.error >= sweep.before]
    found = connection.execute(select(blocks).where(*here)).mappings().all()
    opened = False
    for row in found:
        try:
            parts = split_blocks(dict(row))
        except DamagedRowError:
            continue  # removed as a whole, once all of it is too old
        opened = True
        key = [column == row[column.name] for column in blocks.primary_key.columns]
        connection.execute(delete(blocks).where(*key))
        insert_many(connection, blocks, parts)
        _grow(connection, cache, sweep, sum(len(each["data"]) for each in parts) - len(row["data"]))
    return opened


def _grow(connection: Connection, cache: WriteCache, sweep: Sweep, more: int) -> None:
    """Add to a channel's bytes."""
    row = cache.row(connection, channels, sweep.node, sweep.channel)
    if row is not None:
        row["bytes"] += more
        cache.change(channels, sweep.node, sweep.channel)


def _messages(removed: Any) -> int:
    """The number of messages of a removed row."""
    return getattr(removed, "packed", None) or 1


def _counted(table: Table) -> list[ColumnElement[Any]]:
    """Columns of a removed row that count in its channel's totals."""
    if table is blocks:
        size = func.length(table.c.data).label("size")
        return [size, table.c.packed, table.c.t, table.c.dt, table.c.n]
    return [table.c.kind] if table is sealed_messages else []


def _update_totals(
    connection: Connection, cache: WriteCache, sweep: Sweep, table: Table, rows: Sequence[Any]
) -> None:
    if table is sealed_messages and (page := read_page(sweep.channel)):
        _update_page(connection, cache, sweep, page, len(rows))
        return
    row = cache.row(connection, channels, sweep.node, sweep.channel)
    if row is None or table is events:
        return
    place = table.c.place if table is sealed_messages else table.c.channel
    here = (table.c.node == sweep.node) & (place == sweep.channel)
    if table is blocks:
        row["blocks"] -= sum(map(_messages, rows))
        row["samples"] -= sum(removed.n for removed in rows)
        row["bytes"] -= sum(removed.size for removed in rows)
        if row["built"] is not None:
            for removed in rows:
                t, dt, n = removed[-3:]
                cache.invalidate_tiles(row, SampleGrid(t, dt, n, _messages(removed)))
        first = select(func.min(blocks.c.t)).where(here)
    else:
        row["blocks"] -= sum(removed.kind == "block" for removed in rows)
        first = select(func.min(sealed_messages.c.t_lo)).where(here)
    row["t_first"] = connection.execute(first).scalar_one()
    if row["t_first"] is None:
        row |= {"t_last": None, "lo": None, "hi": None}
    cache.change(channels, sweep.node, sweep.channel)


def _update_page(
    connection: Connection, cache: WriteCache, sweep: Sweep, page: tuple[bytes, int], gone: int
) -> None:
    key = slot_of(sweep.node), sweep.node, *page
    row, v = cache.row(connection, pages, *key), sealed_messages.c
    if row is None:
        return
    first = select(func.min(v.t_lo)).where(v.node == sweep.node, v.place == sweep.channel)
    row["frames"] -= gone
    row["t_first"] = connection.execute(first).scalar_one()
    if row["t_first"] is None:
        row["t_last"] = None
    cache.change(pages, *key)


def _record_removal(connection: Connection, sweep: Sweep, gone: int, now: int) -> None:
    r = removals.c
    here = (r.node == sweep.node) & (r.channel == sweep.channel) & (r.reason == sweep.reason)
    values = {"messages": r.messages + gone, "before": sweep.before, "at": now}
    if connection.execute(update(removals).where(here).values(values)).rowcount == 0:
        key = {"node": sweep.node, "channel": sweep.channel, "reason": sweep.reason.value}
        row = key | {"messages": gone, "before": sweep.before, "at": now}
        connection.execute(insert(removals), row)
