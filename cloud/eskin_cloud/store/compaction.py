"""Compact old blocks of a channel into packs, a page at a time.

Packs are built from a snapshot, without the write lock; one transaction replaces the blocks by
their pack, if all of them still exist.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import and_, delete, func, select, tuple_

from eskin.errors import MessageError
from eskin.wire.messages.compacted_block import is_packable
from eskin_cloud.store.compacted_rows import follows, join_blocks
from eskin_cloud.store.damage import DamagedRowError
from eskin_cloud.store.schema.tables import blocks, channels, feed
from eskin_cloud.store.write.bulk_insert import insert_many

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import ColumnElement, Connection

    from eskin_cloud.store.store import Store
    from eskin_cloud.store.write.write_cache import Row

_PAGE: Final = 256
"""Blocks that are read, and then replaced, at once."""
_SAMPLES: Final = 2048
"""Samples of a full pack, so that a few packs fit a database page."""
_BLOCKS: Final = 64
"""Most blocks of a pack."""
_KEY: Final = tuple(blocks.primary_key.columns)


@dataclass(frozen=True, slots=True)
class CompactedPage:
    """A compacted page of a channel's blocks.

    Attributes:
        node: The node.
        channel: The channel.
        gone: Keys of the replaced blocks.
        rows: Rows of their packs.
        size: Bytes of the replaced blocks.
        saved: Bytes saved by the packs.
        since: Start of the page, UTC ns; ``None`` for the channel's beginning.
        until: Start of the next page.
        more: Whether there is a next page.
    """

    node: str
    channel: str
    gone: Sequence[tuple[Any, ...]]
    rows: Sequence[Row]
    size: int
    saved: int
    since: int | None
    until: int
    more: bool


def find_compactable(store: Store, behind: int) -> list[tuple[str, str]]:
    """Channels with blocks that are old enough and not compacted yet.

    Args:
        store: The store.
        behind: A block is old enough once so many messages followed it.

    Raises:
        StoreError: The store cannot be read.
    """
    b, c = blocks.c, channels.c
    since = func.coalesce(c.packed, -(2**63) + 1)
    here = and_(b.node == c.node, b.channel == c.channel, b.t >= since, b.packed.is_(None))
    with store.read() as connection:
        old = _horizon(connection, behind)
        # Only the first one: if it is too young, so are the others, which may be many.
        first = select(b.cursor).where(here).order_by(b.t).limit(1).correlate(channels)
        query = select(c.node, c.channel).where(c.blocks > 0, first.scalar_subquery() <= old)
        rows = connection.execute(query).all()
    return [(node, channel) for node, channel in rows]


def compact_page(store: Store, place: tuple[str, str], behind: int) -> bool:
    """Compact a page of a channel's blocks; returns whether there may be more.

    Args:
        store: The store.
        place: Node and channel.
        behind: See `find_compactable`.

    Raises:
        StoreError: The store cannot be read or written.
    """
    with store.read() as connection:
        made = _compact(connection, place, behind)
    if made is None:
        return False
    store.packed += made.size
    written = store.write(lambda connection: _replace(connection, store, made))
    return written.result() and made.more


def _horizon(connection: Connection, behind: int) -> int:
    return int(connection.execute(select(feed.c.cursor)).scalar_one()) - behind


def _compact(connection: Connection, place: tuple[str, str], behind: int) -> CompactedPage | None:
    """Build packs of the channel's next blocks; the last pack only if it is full."""
    b, c = blocks.c, channels.c
    here = and_(c.node == place[0], c.channel == place[1])
    since = connection.execute(select(c.packed).where(here)).scalar_one_or_none()
    query = select(blocks).where(b.node == place[0], b.channel == place[1], b.packed.is_(None))
    if since is not None:
        query = query.where(b.t >= since)
    rows = connection.execute(query.order_by(b.t, b.boot, b.sequence).limit(_PAGE)).mappings().all()
    horizon = _horizon(connection, behind)
    old = next((k for k, row in enumerate(rows) if row["cursor"] > horizon), len(rows))
    groups, left = _group(rows[:old])
    full = len(rows) == _PAGE and old == _PAGE
    if old == 0:
        return None
    until = rows[old - left]["t"] if old - left < len(rows) else rows[-1]["t"] + 1
    gone: list[tuple[Any, ...]] = []
    packs: list[Row] = []
    size = saved = 0
    for group in groups:
        try:
            packs.append(join_blocks(group))
        except (MessageError, DamagedRowError):
            continue  # of a kind that is not compacted, or damaged
        gone += [tuple(row[column.name] for column in _KEY) for row in group]
        came = sum(len(row["data"]) for row in group)
        size, saved = size + came, saved + came - len(packs[-1]["data"])
    if until == since and not packs:
        return None
    return CompactedPage(*place, gone, packs, size, saved, since, until, full)


def _group(rows: Sequence[Any]) -> tuple[list[list[Any]], int]:
    """Group blocks by pack; returns also how many at the end do not fill one."""
    groups: list[list[Any]] = []
    open_: list[Any] = []
    for row in rows:
        good = is_packable(row["data"])
        if open_ and not (good and follows(open_[-1], row) and not _is_full(open_)):
            groups.append(open_)
            open_ = []
        if good:
            open_.append(row)
    if open_ and _is_full(open_):
        groups.append(open_)
        open_ = []
    return groups, len(open_)


def _is_full(group: Sequence[Any]) -> bool:
    return len(group) >= _BLOCKS or sum(row["n"] for row in group) >= _SAMPLES


def _replace(connection: Connection, store: Store, made: CompactedPage) -> bool:
    """Replace blocks by their packs, unless a block changed meanwhile."""
    cache = store.cache
    row = cache.row(connection, channels, made.node, made.channel)
    if row is None or row["packed"] != made.since:
        return False
    if made.gone:
        where: ColumnElement[bool] = tuple_(*_KEY).in_(made.gone)
        here = select(func.count()).select_from(blocks).where(where, blocks.c.packed.is_(None))
        if connection.execute(here).scalar_one() != len(made.gone):
            return False
        connection.execute(delete(blocks).where(where))
        insert_many(connection, blocks, made.rows)
        row["bytes"] -= made.saved
        row["longest"] = max(row["longest"], *(each["t_end"] - each["t"] for each in made.rows))
    row["packed"] = made.until
    cache.change(channels, made.node, made.channel)
    return True
