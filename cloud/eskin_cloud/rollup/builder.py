"""Building the pyramid behind ingest: what is new is claimed, made, then written in one step.

First a channel's chunks are claimed: marked as stale, and the channel as built beyond them. From
then on a block that comes late for them marks them anew, in its own transaction. A chunk is made
from one state of the store, without the write lock; it is written, with all levels above it, if its
mark still stands, else made again. Between channels it gives way to whoever else writes: chunks of
all channels of a node are whole at the same moment, and together they take a quarter of a second.
"""

from __future__ import annotations

from bisect import bisect
from dataclasses import dataclass
from functools import partial
from itertools import accumulate, groupby
from operator import attrgetter
from typing import TYPE_CHECKING, Final, TypeAlias

from sqlalchemy import bindparam, case, delete, select, tuple_

from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.rollup.blocks import Buckets, read_folded
from eskin_cloud.rollup.levels import write_levels
from eskin_cloud.store.read.block_index import before
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import CHUNK, MOST_CHUNKS, SampleGrid
from eskin_cloud.store.schema.tables import blocks, channels
from eskin_cloud.store.schema.tile_tables import stale, tiles

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from eskin_cloud.rollup.aggregates import Aggregates
    from eskin_cloud.store import Store
    from eskin_cloud.store.write.write_cache import WriteCache
    from eskin_cloud.store.write.writer import Writer

Place: TypeAlias = tuple[str, str]
Key: TypeAlias = tuple[str, str, int]

_PAGE: Final = 4096
_MARKS: Final = _PAGE * MOST_CHUNKS
"""Chunks that are marked at once, as packs of slow samples have many."""
_CLEARED: Final = 1024
AT_ONCE: Final = 64
"""Chunks that are made in one step, and written in one where nobody else waits to write."""
_DELETE: Final = delete(stale).where(
    stale.c.node == bindparam("n"),
    stale.c.channel == bindparam("c"),
    stale.c.chunk == bindparam("k"),
    stale.c.mark == bindparam("m"),
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
"""What is left of a pyramid that does not count any more, some of it at once."""


@dataclass(frozen=True, slots=True)
class Made:
    """A chunk of a channel's lowest level, and the mark that it had when it was made."""

    node: str
    channel: str
    grain: int
    chunk: int
    mark: int
    pieces: Aggregates


def build(store: Store) -> None:
    """Bring the pyramid up to date at once.

    Raises:
        StoreError: The store cannot be read or written.
    """
    for place in find_growing(store):
        while claim(store, place):
            pass
    after: Key | None = None
    while (after := repair(store, after)) is not None:
        pass


def find_growing(store: Store) -> list[Place]:
    """Channels with blocks of whole chunks that nobody claimed.

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
    """Claim some of a channel's chunks; gives whether there are more.

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
    # Nothing beside the index is read, but of the few rows that reach far.
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
    if full:  # what follows begins after the last; one chunk is always whole
        horizon = max(found[-1].t >> bits << bits, begun + (1 << bits))
    if found and horizon <= begun:
        return False
    row["built"] = horizon
    for comb in found:
        cache.outdate(row, comb, since=begun)
    more = full or row["built"] is None
    cache.change(channels, *place)
    return more


def _most_marks(comb: SampleGrid) -> int:
    return min(comb.n, MOST_CHUNKS * comb.messages)


def repair(store: Store, after: Key | None) -> Key | None:
    """Make some stale chunks anew.

    Args:
        store: The store.
        after: Go on behind this one.

    Returns:
        The last one looked at; ``None`` if there was none.

    Raises:
        StoreError: The store cannot be read or written.
    """
    with store.read() as connection:
        made = _make(connection, after)
    if not made:
        return None
    left: Sequence[Made] = made
    while left:
        keep = partial(_keep, made=left, writer=store.writer)
        left = left[store.write(keep).result() :]
    return made[-1].node, made[-1].channel, made[-1].chunk


def _make(connection: Connection, after: Key | None) -> list[Made]:
    s = stale.c
    query = select(stale).order_by(s.node, s.channel, s.chunk).limit(AT_ONCE)
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
        made.append(Made(row.node, row.channel, grain, row.chunk, row.mark, pieces))
    return made


def _keep(connection: Connection, made: Sequence[Made], writer: Writer) -> int:
    """Write what was made where nothing changed meanwhile, a channel at least; gives how many."""
    done = 0
    for (node, channel, grain), each in groupby(made, attrgetter("node", "channel", "grain")):
        mine = list(each)
        good = {one.chunk: one.pieces for one in mine if _still_stands(connection, one)}
        if good:
            write_levels(connection, (node, channel), grain, good)
        done += len(mine)
        if writer.waiting:
            break
    return done


def _still_stands(connection: Connection, made: Made) -> bool:
    """Whether the mark is there with which a chunk was made; it is taken away."""
    said = {"n": made.node, "c": made.channel, "k": made.chunk, "m": made.mark}
    return connection.execute(_DELETE, said).rowcount > 0
