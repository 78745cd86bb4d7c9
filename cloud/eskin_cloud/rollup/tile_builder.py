"""Build tiles in the background: claim chunks, build them, then write them.

To claim chunks marks them as stale, and the channel as built beyond them. From then on a late block
marks its chunk again, in its own transaction. A chunk is built from a snapshot, without the write
lock; it is written, with all levels above, if its mark is unchanged, and built again otherwise.
Between channels the builder yields to other writers: the chunks of all channels of a node are
complete at the same time, and take a quarter of a second together.
"""

from __future__ import annotations

from bisect import bisect
from dataclasses import dataclass
from functools import partial
from itertools import accumulate, groupby
from operator import attrgetter
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
from sqlalchemy import bindparam, case, delete, insert, select, tuple_

from eskin.runtime.digest import digest
from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.rollup.aggregates import Aggregates, concatenated
from eskin_cloud.rollup.blocks import Buckets, read_folded
from eskin_cloud.store.damage import is_intact_tile
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window, before
from eskin_cloud.store.sample_grid import CHUNK, MOST_CHUNKS, STEP, TOP, SampleGrid
from eskin_cloud.store.schema.tables import blocks, channels
from eskin_cloud.store.schema.tile_tables import stale_chunks, tiles

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sqlalchemy import ColumnElement, Connection

    from eskin_cloud.store import Store
    from eskin_cloud.store.write.write_cache import WriteCache
    from eskin_cloud.store.write.writer import Writer

Place: TypeAlias = tuple[str, str]
Key: TypeAlias = tuple[str, str, int]

_PAGE: Final = 4096
_MARKS: Final = _PAGE * MOST_CHUNKS
"""Chunks that are marked at once: packs of slow samples have many."""
_CLEARED: Final = 1024
AT_ONCE: Final = 64
"""Chunks that are built at once, and written at once unless other writes wait."""
_DELETE: Final = delete(stale_chunks).where(
    stale_chunks.c.node == bindparam("n"),
    stale_chunks.c.channel == bindparam("c"),
    stale_chunks.c.chunk == bindparam("k"),
    stale_chunks.c.mark == bindparam("m"),
)
_OLD: Final = (
    select(tiles.c.level, tiles.c.chunk)
    .where(tiles.c.node == bindparam("n"), tiles.c.channel == bindparam("c"))
    .limit(_CLEARED)
)
_CLEAR: Final = delete(tiles).where(
    tiles.c.node == bindparam("n"),
    tiles.c.channel == bindparam("c"),
    tuple_(tiles.c.level, tiles.c.chunk).in_(_OLD),
)
"""Deletes some old tiles of a channel."""


@dataclass(frozen=True, slots=True)
class BuiltChunk:
    """A built chunk of a channel's lowest level, and its mark at that time."""

    node: str
    channel: str
    grain: int
    chunk: int
    mark: int
    pieces: Aggregates


def build(store: Store) -> None:
    """Build all tiles that are due.

    Raises:
        StoreError: The store cannot be read or written.
    """
    for place in find_unclaimed(store):
        while claim(store, place):
            pass
    after: Key | None = None
    while (after := rebuild_stale(store, after)) is not None:
        pass


def find_unclaimed(store: Store) -> list[Place]:
    """Channels with complete chunks that are not claimed.

    Raises:
        StoreError: The store cannot be read.
    """
    c = channels.c
    query = select(c.node, c.channel, c.grain, c.built, c.t_first, c.t_last)
    query = query.where(c.blocks > 0, c.grain.is_not(None))
    with store.read() as connection:
        rows = connection.execute(query).all()
    return [
        (row.node, row.channel)
        for row in rows
        if (row.t_first if row.built is None else row.built)
        < row.t_last >> (row.grain + CHUNK) << (row.grain + CHUNK)
    ]


def claim(store: Store, place: Place) -> bool:
    """Claim some of a channel's chunks; returns whether there are more.

    Raises:
        StoreError: The store cannot be written.
    """
    return store.write(lambda connection: _claim(connection, store.cache, place)).result()


def _claim(connection: Connection, cache: WriteCache, place: Place) -> bool:
    row = cache.row(connection, channels, *place)
    if row is None or row["t_last"] is None:
        return False
    if row["built"] is None and connection.execute(_CLEAR, {"n": place[0], "c": place[1]}).rowcount:
        return True
    bits, b = row["grain"] + CHUNK, blocks.c
    # Reads only the index, but for the few rows with a long span.
    wide = min((MOST_CHUNKS - 1) << bits, MOST_MOMENT)
    messages = case((b.t_end - b.t >= wide, b.packed))
    query = select(b.t, b.dt, b.n, messages).where(b.node == place[0], b.channel == place[1])
    if row["built"] is not None:
        earliest = before(row["built"], row["longest"])
        query = query.where(b.t >= earliest, b.t_end >= row["built"])
    rows = connection.execute(query.order_by(b.t).limit(_PAGE))
    page = [SampleGrid(t, dt, n, packed or 1) for t, dt, n, packed in rows]
    found = page[: bisect(list(accumulate(map(_most_marks, page))), _MARKS)]
    full = len(page) == _PAGE or len(found) < len(page)
    begun = (found[0].t >> bits << bits) if found else row["t_last"]
    begun = begun if row["built"] is None else max(begun, row["built"])
    horizon = row["t_last"] >> bits << bits
    if full:  # later rows begin after the last one; one chunk is always complete
        horizon = max(found[-1].t >> bits << bits, begun + (1 << bits))
    if found and horizon <= begun:
        return False
    row["built"] = horizon
    for samples in found:
        cache.invalidate_tiles(row, samples, since=begun)
    more = full or row["built"] is None
    cache.change(channels, *place)
    return more


def _most_marks(samples: SampleGrid) -> int:
    return min(samples.n, MOST_CHUNKS * samples.messages)


def rebuild_stale(store: Store, after: Key | None) -> Key | None:
    """Rebuild some stale chunks.

    Args:
        store: The store.
        after: The last chunk of the previous call.

    Returns:
        The last chunk; ``None`` if there was none.

    Raises:
        StoreError: The store cannot be read or written.
    """
    with store.read() as connection:
        made = _build(connection, after)
    if not made:
        return None
    left: Sequence[BuiltChunk] = made
    while left:
        keep = partial(_write, made=left, writer=store.writer)
        left = left[store.write(keep).result() :]
    return made[-1].node, made[-1].channel, made[-1].chunk


def _build(connection: Connection, after: Key | None) -> list[BuiltChunk]:
    s = stale_chunks.c
    query = select(stale_chunks).order_by(s.node, s.channel, s.chunk).limit(AT_ONCE)
    if after is not None:
        query = query.where(tuple_(s.node, s.channel, s.chunk) > tuple_(*after))
    made, known = [], {}
    for row in connection.execute(query).all():
        place = row.node, row.channel
        if place not in known:
            known[place] = find_channel(connection, *place)
        channel, grain = known[place], known[place]["grain"]
        first, end = row.chunk << (grain + CHUNK), (row.chunk + 1) << (grain + CHUNK)
        buckets = Buckets(first, 1 << grain, 1 << CHUNK)
        pieces = read_folded(connection, channel, Window(first, min(end, MOST_MOMENT)), buckets)
        made.append(BuiltChunk(row.node, row.channel, grain, row.chunk, row.mark, pieces))
    return made


def _write(connection: Connection, made: Sequence[BuiltChunk], writer: Writer) -> int:
    """Write unchanged chunks, at least one channel's; returns how many were handled."""
    done = 0
    for (node, channel, grain), each in groupby(made, attrgetter("node", "channel", "grain")):
        mine = list(each)
        good = {one.chunk: one.pieces for one in mine if _clear_mark(connection, one)}
        if good:
            write_levels(connection, (node, channel), grain, good)
        done += len(mine)
        if writer.waiting:
            break
    return done


def _clear_mark(connection: Connection, made: BuiltChunk) -> bool:
    """Delete a chunk's mark; returns whether it was unchanged."""
    parameters = {"n": made.node, "c": made.channel, "k": made.chunk, "m": made.mark}
    return connection.execute(_DELETE, parameters).rowcount > 0


def write_levels(
    connection: Connection, place: tuple[str, str], grain: int, chunks: Mapping[int, Aggregates]
) -> None:
    """Replace chunks of a channel's lowest level, and update each level above.

    Args:
        connection: The writer's, in a transaction.
        place: Node and channel.
        grain: The lowest level.
        chunks: The chunks by number.
    """
    _replace(connection, place, grain, chunks)
    for level in range(grain + STEP, TOP + 1, STEP):
        chunks = _next_level(connection, place, level, chunks)
        _replace(connection, place, level, chunks)


def _next_level(
    connection: Connection, place: tuple[str, str], level: int, below: Mapping[int, Aggregates]
) -> dict[int, Aggregates]:
    """The chunks of a level above some changed chunks."""
    numbers = sorted({chunk >> STEP for chunk in below})
    query = select(tiles.c.chunk, tiles.c.data, tiles.c.digest)
    query = query.where(_at(place, level, numbers))
    standing = connection.execute(query).all()
    changed = np.array(sorted(below), np.int64)
    parts: dict[int, list[Aggregates]] = {number: [] for number in numbers}
    for number, data, own in standing:
        sound = is_intact_tile(data, own, (*place, level, number))
        old = Aggregates.unpack([data]) if sound else _rebuild(connection, place, level, number)
        beneath = old.first >> (level - STEP + CHUNK)
        parts[number].append(old[~np.isin(beneath, changed)])
    for chunk, pieces in below.items():
        parts[chunk >> STEP].append(pieces.grouped(pieces.first >> level))
    return {number: concatenated(each) for number, each in parts.items()}


def _rebuild(connection: Connection, place: tuple[str, str], level: int, number: int) -> Aggregates:
    """Rebuild a damaged chunk from its blocks."""
    start, end = number << (level + CHUNK), (number + 1) << (level + CHUNK)
    buckets = Buckets(start, 1 << level, 1 << CHUNK)
    channel = find_channel(connection, *place)
    return read_folded(connection, channel, Window(start, min(end, MOST_MOMENT)), buckets)


def _replace(
    connection: Connection, place: tuple[str, str], level: int, chunks: Mapping[int, Aggregates]
) -> None:
    connection.execute(delete(tiles).where(_at(place, level, chunks)))
    key = {"node": place[0], "channel": place[1], "level": level}
    packed = {n: each.pack() for n, each in chunks.items() if len(each)}
    rows = [key | {"chunk": n, "data": d, "digest": digest(d)} for n, d in packed.items()]
    if rows:
        connection.execute(insert(tiles), rows)


def _at(place: tuple[str, str], level: int, chunks: Iterable[int]) -> ColumnElement[bool]:
    t = tiles.c
    here = (t.node == place[0]) & (t.channel == place[1]) & (t.level == level)
    return here & t.chunk.in_(list(chunks))
