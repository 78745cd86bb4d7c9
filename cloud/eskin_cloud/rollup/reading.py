"""Read aggregates from tiles, and from blocks where tiles are stale or damaged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
from sqlalchemy import bindparam, select

from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.rollup.aggregates import EMPTY, Aggregates, concatenated
from eskin_cloud.rollup.blocks import Buckets, read_buckets, read_folded
from eskin_cloud.store.damage import is_intact_tile
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import CHUNK, STEP
from eskin_cloud.store.schema.tile_tables import stale_chunks, tiles

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sqlalchemy import Connection

    from eskin_cloud.rollup.aggregates import Integers
    from eskin_cloud.store.read.lookup import Channel

_STALE: Final = select(stale_chunks.c.chunk).where(
    stale_chunks.c.node == bindparam("node"),
    stale_chunks.c.channel == bindparam("channel"),
    stale_chunks.c.chunk.between(bindparam("first"), bindparam("last")),
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
        """Their times, UTC ns, limited to 64 bits."""
        return self.first << self.level, min(self.end << self.level, MOST_MOMENT)


def read_range(connection: Connection, channel: Channel, stretch: TileRange) -> Aggregates:
    """Exact aggregates of all samples in a range of tiles, none across a tile's end.

    Tiles above stale chunks are replaced by those of lower levels, and stale chunks by blocks.

    Args:
        connection: In a read transaction.
        channel: The channel's row.
        stretch: Tiles of a level of the channel.
    """
    opened = find_unbuilt(connection, channel, stretch.range)
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


def find_unbuilt(connection: Connection, channel: Channel, within: Range) -> list[Range]:
    """The ranges in which blocks must be read instead of tiles, UTC ns."""
    built, bits = channel["built"], channel["grain"] + CHUNK
    if built is None:
        return [within]
    parameters = _parameters(channel, within[0] >> bits, within[1] >> bits)
    found = connection.execute(_STALE, parameters).scalars()
    opened = [(chunk << bits, (chunk + 1) << bits) for chunk in found]
    clipped = ((max(a, within[0]), min(b, within[1])) for a, b in [*opened, (built, MOST_MOMENT)])
    return merged(clipped)


def read_tiles(
    connection: Connection, channel: Channel, level: int, ranges: list[Range]
) -> Aggregates:
    """The tiles of a level in some ranges of numbers; stale ones included.

    Blocks are read instead of damaged chunks.
    """
    chunks = [n for first, end in coarsened(ranges, CHUNK) for n in range(first, end)]
    if not chunks:
        return EMPTY
    query, parameters = _TILES, _parameters(channel, chunks[0], chunks[-1]) | {"level": level}
    if chunks[-1] - chunks[0] >= len(chunks):
        query = query.where(tiles.c.chunk.in_(chunks))
    place = channel["node"], channel["channel"], level
    sound: list[bytes] = []
    damaged: list[Range] = []
    for chunk, data, own in connection.execute(query, parameters):
        if is_intact_tile(data, own, (*place, chunk)):
            sound.append(data)
        else:
            damaged.append((chunk << CHUNK, (chunk + 1) << CHUNK))
    found = Aggregates.unpack(sound)
    read = _inside(found, found.first >> level, ranges)
    if not damaged:
        return read
    lost = [_folded(connection, channel, level, each) for each in _common(ranges, damaged)]
    return concatenated([read, *lost])


def _folded(connection: Connection, channel: Channel, level: int, within: Range) -> Aggregates:
    """Compute tiles from blocks."""
    start, end = within[0] << level, min(within[1] << level, MOST_MOMENT)
    buckets = Buckets(start, 1 << level, within[1] - within[0])
    return read_folded(connection, channel, Window(start, end), buckets)


def _common(ranges: list[Range], others: list[Range]) -> list[Range]:
    """The intersection of ranges."""
    found = [(max(a, c), min(b, d)) for a, b in ranges for c, d in others]
    return [(first, end) for first, end in found if first < end]


def _parameters(channel: Channel, first: int, last: int) -> dict[str, str | int]:
    return {"node": channel["node"], "channel": channel["channel"], "first": first, "last": last}


def _inside(pieces: Aggregates, numbers: Integers, ranges: list[Range]) -> Aggregates:
    """The entries whose sorted ``numbers`` lie in some ranges."""
    places = np.searchsorted(numbers, np.array(ranges, np.int64).ravel()).reshape(-1, 2).tolist()
    if len(places) == 1:
        return pieces[slice(*places[0])]
    return pieces[np.concatenate([np.arange(*place) for place in places])]


Range: TypeAlias = tuple[int, int]


def merged(ranges: Iterable[Range]) -> list[Range]:
    """Sort ranges, and merge those that touch."""
    found: list[Range] = []
    for first, end in sorted(ranges):
        if first >= end:
            continue
        if found and first <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], end)
        else:
            found.append((first, end))
    return found


def without(ranges: Iterable[Range], holes: Iterable[Range]) -> list[Range]:
    """Ranges without ``holes``; both sorted and disjoint."""
    left: list[Range] = []
    waiting = list(holes)[::-1]
    for first, end in ranges:
        begin = first
        while waiting and waiting[-1][0] < end:
            hole = waiting[-1]
            if hole[0] > begin:
                left.append((begin, hole[0]))
            begin = max(begin, hole[1])
            if hole[1] > end:
                break
            waiting.pop()
        if begin < end:
            left.append((begin, end))
    return left


def coarsened(ranges: Iterable[Range], bits: int) -> list[Range]:
    """The ranges in units ``2^bits`` times larger that cover all of these."""
    return merged((first >> bits, -(-end >> bits)) for first, end in ranges)


def refined(ranges: Iterable[Range], bits: int) -> list[Range]:
    """The same ranges in units ``2^bits`` times smaller."""
    return [(first << bits, end << bits) for first, end in ranges]
