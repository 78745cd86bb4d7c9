"""Remove old messages and those of erased subjects, a few in each transaction.

`sequences` stay, so that a copy of a removed message is still a duplicate. Totals of pages and
patches decrease.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sqlalchemy import and_, delete, exists, func, select, tuple_

from eskin.privacy.sealed_message import read_page
from eskin.wire.slot import key_of
from eskin_cloud.store.feed_entry import note_compacted
from eskin_cloud.store.patch_totals import Place, subtract_rows
from eskin_cloud.store.schema.frame_tables import frames, pages, patch_rows
from eskin_cloud.store.schema.node_key import of_node, of_same_node
from eskin_cloud.store.schema.sealed_tables import (
    erased_subjects,
    is_of_erased_subject,
    sealed_messages,
)
from eskin_cloud.store.schema.tables import events, node_sites
from eskin_cloud.store.write.removal_counts import RemovalReason, Sweep, record_removal

if TYPE_CHECKING:
    from sqlalchemy import ColumnElement, Connection

    from eskin_cloud.store.write.write_cache import WriteCache


def remove(connection: Connection, cache: WriteCache, sweep: Sweep, *, most: int, now: int) -> int:
    """Remove some messages of a sweep; returns their number, below ``most`` at the end.

    Args:
        connection: The writer's, in a transaction.
        cache: The writer's.
        sweep: What to remove.
        most: Limit of messages.
        now: UTC ns.
    """
    key, gone = tuple_(*sealed_messages.primary_key.columns), 0
    for due in _conditions(sweep):
        v = sealed_messages.c
        here = and_(of_node(sealed_messages, sweep.node), v.place == sweep.place, due)
        some = select(*sealed_messages.primary_key.columns).where(here).limit(most - gone)
        gone += connection.execute(delete(sealed_messages).where(key.in_(some))).rowcount
    if gone:
        _subtract(connection, cache, sweep, gone)
        record_removal(connection, sweep, gone, now)
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
        of_patch = e.channel.in_(sweep.channels)
        gone += _remove_events(connection, sweep.node, of_patch, sweep.before, most - gone)
    if gone:
        as_place = Sweep(sweep.node, sweep.patch, RemovalReason.AGE, sweep.before)
        record_removal(connection, as_place, gone, now)
    return gone


def remove_node_events(connection: Connection, node: str, before: int, *, most: int) -> int:
    """Remove some events of a node as a whole: its contacts, status, commands and gaps.

    Args:
        connection: The writer's, in a transaction.
        node: The node.
        before: Events that ended before it are removed, UTC ns.
        most: Limit of events.
    """
    return _remove_events(connection, node, events.c.channel.is_(None), before, most)


def _remove_events(
    connection: Connection, node: str, which: ColumnElement[bool], before: int, most: int
) -> int:
    e = events.c
    old = select(e.cursor).where(of_node(events, node), which, e.t_lo < before, e.t_hi < before)
    cursors = connection.execute(old.limit(most)).scalars().all()
    if not cursors:
        return 0
    here = of_node(events, node) & e.cursor.in_(cursors)
    return connection.execute(delete(events).where(here)).rowcount


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
    here = and_(of_node(frames, page[1]), f.page == page[3], f.layout == page[2])
    old = here & (f.t < min(before, row["compacted"])) & (f.t_end + f.error < before)
    totals = func.count(), func.max(f.cursor), func.sum(f.samples), func.sum(func.length(f.data))
    count, latest, samples, size = connection.execute(select(*totals).where(old)).one()
    if count:
        connection.execute(delete(frames).where(old))
        note_compacted(connection, latest)
        row["frames"] -= count
        row["samples"] -= samples
        row["bytes"] -= size
        row["t_first"] = connection.execute(select(func.min(f.t)).where(here)).scalar_one()
        if row["t_first"] is None:
            row["t_last"] = None
        cache.change(pages, *page)
    return int(count)


def sweeps_of_erased(connection: Connection) -> list[Sweep]:
    """The remaining messages of erased subjects, by place."""
    v = sealed_messages.c
    query = select(v.node, v.place, func.max(v.t_hi)).where(is_of_erased_subject())
    rows = connection.execute(query.group_by(v.slot, v.node, v.place)).all()
    return [Sweep(row[0], row[1], RemovalReason.ERASURE, row[2]) for row in rows]


def unfinished_erasures(connection: Connection) -> list[tuple[str, str]]:
    """Site and subject of the erasures whose rows may not all be deleted."""
    e = erased_subjects.c
    query = select(e.site, e.subject).where(e.removed.is_(None)).order_by(e.site, e.subject)
    return [(site, subject) for site, subject in connection.execute(query)]


def has_messages(connection: Connection, site: str, subject: str) -> bool:
    """Whether sealed messages of a site's subject are stored."""
    v, n = sealed_messages.c, node_sites.c
    here = (v.subject == subject) & of_same_node(node_sites, sealed_messages) & (n.site == site)
    return bool(connection.execute(select(exists(select(v.node).where(here)))).scalar_one())


def _conditions(sweep: Sweep) -> list[ColumnElement[bool]]:
    """Which messages of the place are removed; each condition can use an index."""
    if sweep.reason is RemovalReason.ERASURE:
        return [is_of_erased_subject()]
    v = sealed_messages.c
    return [
        (v.t_lo < sweep.before) & (v.t_hi < sweep.before),
        # The message's own time may be far ahead, if the node's clock was: use the cloud's, too.
        v.received < sweep.before,
    ]


def _subtract(connection: Connection, cache: WriteCache, sweep: Sweep, gone: int) -> None:
    """Subtract removed frames from the totals of their page."""
    page = read_page(sweep.place)
    if page is None:
        return  # statements, which are not counted
    key = *key_of(sweep.node), *page
    row, v = cache.row(connection, pages, *key), sealed_messages.c
    if row is None:
        return
    first = select(func.min(v.t_lo)).where(
        of_node(sealed_messages, sweep.node), v.place == sweep.place
    )
    row["frames"] -= gone
    row["t_first"] = connection.execute(first).scalar_one()
    if row["t_first"] is None:
        row["t_last"] = None
    cache.change(pages, *key)
