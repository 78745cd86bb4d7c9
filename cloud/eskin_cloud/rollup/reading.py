"""Read aggregates from tiles, and from samples where tiles are stale."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.rollup.aggregates import Aggregates, concatenated
from eskin_cloud.rollup.buckets import Buckets
from eskin_cloud.rollup.patch_tiles import find_unbuilt, read_tiles
from eskin_cloud.rollup.ranges import coarsened, common, refined, without
from eskin_cloud.rollup.samples import read_buckets
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import PATCH_CHUNK, STEP

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from eskin_cloud.rollup.ranges import Range
    from eskin_cloud.store.read.lookup import Channel


def read_ranges(
    connection: Connection, channel: Channel, level: int, ranges: Sequence[Range]
) -> Aggregates:
    """Exact aggregates of all samples in some tiles of a level, none across a tile's end.

    Tiles above stale chunks are replaced by those of lower levels, and stale chunks by samples.
    Where a channel has no tiles of the level, all of them are made of samples.

    Args:
        connection: In a read transaction.
        channel: The channel.
        level: The tiles are ``2^level`` ns wide.
        ranges: Numbers of tiles, sorted and disjoint, at least one.
    """
    within = [(first << level, min(end << level, MOST_MOMENT)) for first, end in ranges]
    opened, found, grain = within, [], channel["grain"]
    if grain is not None and level >= grain:
        opened = common(within, find_unbuilt(connection, channel, (within[0][0], within[-1][1])))
        region = list(ranges)
        for each in range(level, grain - 1, -STEP):
            holes = coarsened(opened, each)
            found.append(read_tiles(connection, channel, each, without(region, holes)))
            if not holes or each <= grain + PATCH_CHUNK:
                break
            region = refined(holes, STEP)
    buckets = Buckets(ranges[0][0] << level, 1 << level, ranges[-1][1] - ranges[0][0])
    found += [read_buckets(connection, channel, Window(*each), buckets) for each in opened]
    return concatenated(found)
