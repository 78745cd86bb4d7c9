"""Read aggregates from tiles, and from samples where tiles are stale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.rollup.aggregates import Aggregates, concatenated
from eskin_cloud.rollup.buckets import Buckets
from eskin_cloud.rollup.patch_tiles import find_unbuilt, read_tiles
from eskin_cloud.rollup.ranges import Range, coarsened, refined, without
from eskin_cloud.rollup.samples import read_buckets
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import PATCH_CHUNK, STEP

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin_cloud.store.read.lookup import Channel


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

    Tiles above stale chunks are replaced by those of lower levels, and stale chunks by samples.

    Args:
        connection: In a read transaction.
        channel: The channel.
        stretch: Tiles of a level of the channel.
    """
    opened = find_unbuilt(connection, channel, stretch.range)
    region, found = [(stretch.first, stretch.end)], []
    for level in range(stretch.level, channel["grain"] - 1, -STEP):
        holes = coarsened(opened, level)
        found.append(read_tiles(connection, channel, level, without(region, holes)))
        if not holes or level <= channel["grain"] + PATCH_CHUNK:
            break
        region = refined(holes, STEP)
    count = stretch.end - stretch.first
    buckets = Buckets(stretch.first << stretch.level, 1 << stretch.level, count)
    found += [read_buckets(connection, channel, Window(*each), buckets) for each in opened]
    return concatenated(found)
