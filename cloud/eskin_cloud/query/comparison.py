"""Compare two channels: by tiles, else by blocks' bounds, else by samples."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from sqlalchemy import select

from eskin.interval import Verdict
from eskin_cloud.query.comparison_segments import ComparisonSegment, compare, merge
from eskin_cloud.query.neighbourhood import look_around
from eskin_cloud.query.tile_comparison import TileVerdict, classify, read_grid
from eskin_cloud.store.read.patch_columns import has_rows, is_column, split_column
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import STEP, TOP
from eskin_cloud.store.schema.tables import blocks

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_cloud.query.neighbourhood import ChannelSource

_TILES: Final = 64
"""Least tiles of the highest level that is read."""
_AT_ONCE: Final = 256


def find_comparison_segments(
    one: ChannelSource, other: ChannelSource, window: Window
) -> Iterator[ComparisonSegment]:
    """Segments of a window with one verdict each, in order of time.

    Args:
        one: The channel that may be above.
        other: The other channel, of the same unit.
        window: The window.
    """
    return merge(_find((one, other), window))


def _find(
    sides: tuple[ChannelSource, ChannelSource], window: Window
) -> Iterator[ComparisonSegment]:
    grains = [side.channel["grain"] for side in sides]
    if window.span == 0:
        return
    if None in grains or window.span >> max(grains) < _TILES:
        yield from _of_blocks(sides, window)
        return
    level = grain = max(grains)
    while level + STEP <= TOP and window.span >> (level + STEP) >= _TILES:
        level += STEP
    yield from _level(sides, window, level, grain)


def _level(
    sides: tuple[ChannelSource, ChannelSource], window: Window, level: int, grain: int
) -> Iterator[ComparisonSegment]:
    """The verdicts of a level's tiles; undecided ones are resolved by lower levels."""
    first, end = window.start >> level, ((window.end - 1) >> level) + 1
    grids = tuple(read_grid(side, level, first, end) for side in sides)
    for fate, begin, stop, samples in classify(*grids):
        start, over = (first + begin) << level, (first + stop) << level
        part = Window(max(start, window.start), min(over, window.end))
        if fate is TileVerdict.ABOVE:
            yield ComparisonSegment(part.start, part.end, Verdict.CERTAIN, samples=samples)
        elif fate is TileVerdict.NOT_ABOVE:
            yield ComparisonSegment(part.start, part.end, Verdict.IMPOSSIBLE, samples=samples)
        elif fate is TileVerdict.EMPTY:
            yield from _of_gap(sides, part)
        elif fate is TileVerdict.CHANGED or level == grain:
            yield from _of_blocks(sides, part)
        else:
            for at in range(part.start, part.end, _TILES << level):
                within = Window(at, min(at + (_TILES << level), part.end))
                yield from _level(sides, within, level - STEP, grain)


def _of_gap(
    sides: tuple[ChannelSource, ChannelSource], window: Window
) -> Iterator[ComparisonSegment]:
    """A window in which a channel has no samples; an earlier one may be valid at its start."""
    at = window.start
    for start, end in _known(sides, window):
        if start > at:
            yield ComparisonSegment(at, start, None)
        yield from _of_blocks(sides, Window(start, end))
        at = end
    if at < window.end:
        yield ComparisonSegment(at, window.end, None)


def _known(sides: tuple[ChannelSource, ChannelSource], window: Window) -> Iterator[tuple[int, int]]:
    """The ranges in which the channel with fewer samples is known."""
    some = [side for side in sides if not _has_blocks(side, window)]
    if not some:
        yield window.start, window.end
        return
    known = look_around(some[0], window).holding.known
    for start, end in zip(*(each.tolist() for each in known), strict=True):
        if max(start, window.start) < min(end, window.end):
            yield max(start, window.start), min(end, window.end)


def _has_blocks(side: ChannelSource, window: Window) -> bool:
    """Whether a block or a frame may begin in a window, after its start."""
    if is_column(side.channel):
        return has_rows(side.connection, side.channel, window)
    return bool(_next_blocks(side, window, 1))


def _next_end(side: ChannelSource, window: Window) -> int:
    """Up to where a channel is read at once."""
    if is_column(side.channel):
        return next(split_column(side.connection, side.channel, window)).end
    starts = _next_blocks(side, window, _AT_ONCE)
    return starts[-1] if len(starts) == _AT_ONCE else window.end


def _next_blocks(side: ChannelSource, window: Window, count: int) -> list[int]:
    """The starts of a channel's next blocks."""
    b, channel = blocks.c, side.channel
    query = select(b.t).where(b.node == channel["node"], b.channel == channel["channel"])
    query = query.where(b.t > window.start, b.t < window.end).order_by(b.t).limit(count)
    return list(side.connection.execute(query).scalars())


def _of_blocks(
    sides: tuple[ChannelSource, ChannelSource], window: Window
) -> Iterator[ComparisonSegment]:
    at = window.start
    while at < window.end:
        rest = Window(at, window.end)
        at = min(_next_end(side, rest) for side in sides)
        yield from _of_few(sides, Window(rest.start, at))


def _of_few(
    sides: tuple[ChannelSource, ChannelSource], window: Window
) -> Iterator[ComparisonSegment]:
    """Compare blocks' bounds; undecided blocks are decoded."""
    around = [look_around(side, window) for side in sides]
    while True:
        found = compare(around[0].holding, around[1].holding, window)
        if not np.any(found.open):
            return found.stretches()
        for number, side in enumerate(around):
            side.look(found.straddling(number))
