"""Compare two channels: by tiles, else by samples."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.interval import Verdict
from eskin_cloud.query.comparison_segments import ComparisonSegment, compare, merge
from eskin_cloud.query.neighbourhood import look_around
from eskin_cloud.query.tile_comparison import TileVerdict, classify, read_grid
from eskin_cloud.store.read.patch_columns import has_rows, split_column
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import STEP, TOP

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_cloud.query.neighbourhood import ChannelSource

_TILES: Final = 64
"""Least tiles of the highest level that is read."""


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
        yield from _of_samples(sides, window)
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
    coverage = min(grid.coverage for grid in grids)
    for fate, begin, stop, samples in classify(*grids):
        start, over = (first + begin) << level, (first + stop) << level
        part = Window(max(start, window.start), min(over, window.end))
        if fate is TileVerdict.ABOVE:
            yield ComparisonSegment(
                part.start, part.end, Verdict.CERTAIN, samples=samples, coverage=coverage
            )
        elif fate is TileVerdict.NOT_ABOVE:
            yield ComparisonSegment(
                part.start, part.end, Verdict.IMPOSSIBLE, samples=samples, coverage=coverage
            )
        elif fate is TileVerdict.EMPTY:
            yield from _of_gap(sides, part)
        elif fate is TileVerdict.CHANGED or level == grain:
            yield from _of_samples(sides, part)
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
        yield from _of_samples(sides, Window(start, end))
        at = end
    if at < window.end:
        yield ComparisonSegment(at, window.end, None)


def _known(sides: tuple[ChannelSource, ChannelSource], window: Window) -> Iterator[tuple[int, int]]:
    """The ranges in which the channel with fewer samples is known."""
    some = [side for side in sides if not has_rows(*side, window)]
    if not some:
        yield window.start, window.end
        return
    known = look_around(some[0], window).known
    for start, end in zip(*(each.tolist() for each in known), strict=True):
        if max(start, window.start) < min(end, window.end):
            yield max(start, window.start), min(end, window.end)


def _of_samples(
    sides: tuple[ChannelSource, ChannelSource], window: Window
) -> Iterator[ComparisonSegment]:
    at = window.start
    while at < window.end:
        rest = Window(at, window.end)
        at = min(next(split_column(*side, rest)).end for side in sides)
        part = Window(rest.start, at)
        one, other = (look_around(side, part) for side in sides)
        yield from compare(one, other, part).stretches()
