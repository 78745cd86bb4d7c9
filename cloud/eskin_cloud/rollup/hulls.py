"""Choose a window's buckets, and aggregate them: from tiles if long, else from samples."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.wire.timestamp import MOST_INSTANT, SECOND
from eskin_cloud.rollup.aggregates import Aggregates, concatenated
from eskin_cloud.rollup.buckets import Buckets
from eskin_cloud.rollup.patch_tiles import find_unbuilt, read_tiles
from eskin_cloud.rollup.ranges import coarsened, common, refined, without
from eskin_cloud.rollup.samples import read_buckets
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import PATCH_CHUNK, STEP, TOP

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from eskin_cloud.rollup.ranges import Range
    from eskin_cloud.store.read.lookup import Channel

EXACT: Final = 2**53
"""JavaScript keeps integers up to here."""
_TILES: Final = 1024
"""Least tiles of a window that is read from tiles; its ends move by less than a tile."""


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
    within = [(first << level, min(end << level, MOST_INSTANT)) for first, end in ranges]
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


def read_hulls(
    connection: Connection, channel: Channel, window: Window, points: int
) -> tuple[Aggregates, Buckets]:
    """Aggregates of a window's samples, in at most ``points`` buckets.

    A long window's buckets are whole tiles: the first may begin before the window, and the last
    may end after it. No aggregate crosses a bucket's end.
    """
    if not is_tiled(channel, window, points):
        width = bucket_width(window.span, points)
        buckets = Buckets(window.start, width, -(-window.span // width))
        return read_buckets(connection, channel, buckets.window, buckets), buckets
    level = channel["grain"]
    while level + STEP <= TOP and window.span >> (level + STEP) >= max(points, _TILES):
        level += STEP
    first, last = window.start >> level, (window.end - 1) >> level
    each = -(-(last + 1 - first) // points)
    count = -(-(last + 1 - first) // each)
    buckets = Buckets(first << level, each << level, count)
    return read_ranges(connection, channel, level, [(first, first + each * count)]), buckets


def is_tiled(channel: Channel, window: Window, points: int) -> bool:
    """Whether a window is so long that its buckets are whole tiles."""
    grain = channel["grain"]
    return grain is not None and window.span >> grain >= max(points, _TILES)


def widest_window(window: Window) -> Window:
    """The widest window that `read_hulls` may read, whatever the channel's tiles.

    Of at least 1024 tiles, one may begin before the window, and fewer than the square root of their
    number end after it. Buckets that are no tiles exceed its end by less than a second.
    """
    margin = (window.span >> 4) + SECOND
    return Window(max(window.start - margin, -MOST_INSTANT), min(window.end + margin, MOST_INSTANT))


def bucket_width(span: int, points: int) -> int:
    """The least width for which ``points`` buckets span the window, in ns.

    A float64 represents each bucket's start exactly.
    """
    width = max(1, -(-span // points))
    grain = 1
    while width * points >= EXACT * grain:
        grain *= 2
    return -(-width // grain) * grain
