"""Reading the pyramid: a stretch of time from its tiles, from blocks where they are not good."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from sqlalchemy import bindparam, select

from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.rollup.aggregates import EMPTY, Aggregates, concatenated
from eskin_cloud.rollup.blocks import Buckets, read_buckets, read_folded
from eskin_cloud.rollup.ranges import Range, coarsened, merged, refined, without
from eskin_cloud.store.damage import is_sound_tile
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import CHUNK, STEP
from eskin_cloud.store.schema.tile_tables import stale, tiles

if TYPE_CHECKING:
    from sqlalchemy import Connection, RowMapping

    from eskin_cloud.rollup.aggregates import Integers

_STALE: Final = select(stale.c.chunk).where(
    stale.c.node == bindparam("node"),
    stale.c.channel == bindparam("channel"),
    stale.c.chunk.between(bindparam("first"), bindparam("last")),
)
_TILES: Final = (
    select(tiles.c.chunk, tiles.c.data, tiles.c.digest)
    .where(
        tiles.c.node == bindparam("node"),
        tiles.c.channel == bindparam("channel"),
        tiles.c.level == bindparam("level"),
        tiles.c.chunk.between(bindparam("first"), bindparam("last")),
    )
    .order_by(tiles.c.chunk)
)


@dataclass(frozen=True, slots=True)
class TileRange:
    """Neighbouring tiles of a level, from ``first`` up to, and without, ``end``."""

    level: int
    first: int
    end: int

    @property
    def range(self) -> Range:
        """When they are, UTC ns, as far as there is time."""
        return self.first << self.level, min(self.end << self.level, MOST_MOMENT)


def read_stretch(connection: Connection, channel: RowMapping, stretch: TileRange) -> Aggregates:
    """Exact pieces of all samples in a stretch, none of which reaches over a tile's end.

    Tiles over what changed since they were made are left alone, for those below them; on the lowest
    chunks, blocks are read.

    Args:
        connection: Reads one state of the store.
        channel: The channel's row.
        stretch: Of the channel's lowest level, or a whole number of steps above.
    """
    opened = find_open(connection, channel, stretch.range)
    region, found = [(stretch.first, stretch.end)], []
    for level in range(stretch.level, channel["grain"] - 1, -STEP):
        holes = coarsened(opened, level)
        found.append(read_tiles(connection, channel, level, without(region, holes)))
        if not holes or level <= channel["grain"] + CHUNK:
            break
        region = refined(holes, STEP)
    count = stretch.end - stretch.first
    buckets = Buckets(stretch.first << stretch.level, 1 << stretch.level, count)
    found += [read_buckets(connection, channel, Window(*each), buckets) for each in opened]
    return concatenated(found)


def find_open(connection: Connection, channel: RowMapping, within: Range) -> list[Range]:
    """When blocks must be read in the place of tiles, UTC ns."""
    built, bits = channel["built"], channel["grain"] + CHUNK
    if built is None:
        return [within]
    said = _said(channel, within[0] >> bits, within[1] >> bits)
    found = connection.execute(_STALE, said).scalars()
    opened = [(chunk << bits, (chunk + 1) << bits) for chunk in found]
    clipped = ((max(a, within[0]), min(b, within[1])) for a, b in [*opened, (built, MOST_MOMENT)])
    return merged(clipped)


def read_tiles(
    connection: Connection, channel: RowMapping, level: int, ranges: list[Range]
) -> Aggregates:
    """The tiles of a level whose numbers lie in some ranges, as they stand.

    In the place of chunks that are damaged, blocks are read.
    """
    chunks = [n for first, end in coarsened(ranges, CHUNK) for n in range(first, end)]
    if not chunks:
        return EMPTY
    query, said = _TILES, _said(channel, chunks[0], chunks[-1]) | {"level": level}
    if chunks[-1] - chunks[0] >= len(chunks):
        query = query.where(tiles.c.chunk.in_(chunks))
    place = channel["node"], channel["channel"], level
    sound: list[bytes] = []
    damaged: list[Range] = []
    for chunk, data, own in connection.execute(query, said):
        if is_sound_tile(data, own, (*place, chunk)):
            sound.append(data)
        else:
            damaged.append((chunk << CHUNK, (chunk + 1) << CHUNK))
    found = Aggregates.unpack(sound)
    read = _inside(found, found.first >> level, ranges)
    if not damaged:
        return read
    lost = [_folded(connection, channel, level, each) for each in _common(ranges, damaged)]
    return concatenated([read, *lost])


def _folded(connection: Connection, channel: RowMapping, level: int, within: Range) -> Aggregates:
    """Tiles with some numbers of a level, from blocks."""
    start, end = within[0] << level, min(within[1] << level, MOST_MOMENT)
    buckets = Buckets(start, 1 << level, within[1] - within[0])
    return read_folded(connection, channel, Window(start, end), buckets)


def _common(ranges: list[Range], others: list[Range]) -> list[Range]:
    """What lies in one of some ranges and in one of others."""
    found = [(max(a, c), min(b, d)) for a, b in ranges for c, d in others]
    return [(first, end) for first, end in found if first < end]


def _said(channel: RowMapping, first: int, last: int) -> dict[str, str | int]:
    return {"node": channel["node"], "channel": channel["channel"], "first": first, "last": last}


def _inside(pieces: Aggregates, numbers: Integers, ranges: list[Range]) -> Aggregates:
    """Those whose numbers, which never fall, lie in some ranges."""
    places = np.searchsorted(numbers, np.array(ranges, np.int64).ravel()).reshape(-1, 2).tolist()
    if len(places) == 1:
        return pieces[slice(*places[0])]
    return pieces[np.concatenate([np.arange(*place) for place in places])]
