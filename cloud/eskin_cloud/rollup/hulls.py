"""Which buckets a window is answered in, and their pieces: of tiles if it is long, else blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.wire.timestamp import MOST_MOMENT, SECOND
from eskin_cloud.rollup.blocks import Buckets, read_buckets
from eskin_cloud.rollup.reading import TileRange, read_stretch
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import STEP, TOP

if TYPE_CHECKING:
    from sqlalchemy import Connection, RowMapping

    from eskin_cloud.rollup.aggregates import Aggregates

EXACT: Final = 2**53
"""JavaScript keeps integers up to here."""
_TILES: Final = 1024
"""A window is as many tiles long at least, where there are any: its ends move by less than that."""


def read_hulls(
    connection: Connection, channel: RowMapping, window: Window, points: int
) -> tuple[Aggregates, Buckets]:
    """Pieces of all samples in at most ``points`` buckets that span a window.

    A long window's buckets are whole tiles, so that the first may begin before the window does; the
    last may end behind it. Each piece lies in one bucket as a whole.
    """
    grain = channel["grain"]
    if grain is None or window.span >> grain < max(points, _TILES):
        width = bucket_width(window.span, points)
        buckets = Buckets(window.start, width, -(-window.span // width))
        return read_buckets(connection, channel, buckets.window, buckets), buckets
    level = grain
    while level + STEP <= TOP and window.span >> (level + STEP) >= max(2 * points, 2 * _TILES):
        level += STEP
    first, last = window.start >> level, (window.end - 1) >> level
    each = -(-(last + 1 - first) // points)
    count = -(-(last + 1 - first) // each)
    buckets = Buckets(first << level, each << level, count)
    stretch = TileRange(level, first, first + each * count)
    return read_stretch(connection, channel, stretch), buckets


def reach(window: Window) -> Window:
    """All that the buckets of a window may span, whatever its channel's tiles are.

    They are 1024 at least, of which one may begin before the window, and fewer than their number's
    root end behind it. Where buckets are no tiles, they reach over its end by less than a second.
    """
    margin = (window.span >> 4) + SECOND
    return Window(max(window.start - margin, -MOST_MOMENT), min(window.end + margin, MOST_MOMENT))


def bucket_width(span: int, points: int) -> int:
    """The least width for which ``points`` buckets span the window, in ns.

    Every bucket's start is then an integer that a float64 keeps exact.
    """
    width = max(1, -(-span // points))
    grain = 1
    while width * points >= EXACT * grain:
        grain *= 2
    return -(-width // grain) * grain
