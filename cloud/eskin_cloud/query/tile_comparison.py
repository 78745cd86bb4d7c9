"""Compare two channels by tiles of one level."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from eskin_cloud.rollup.aggregates import longest_step
from eskin_cloud.rollup.patch_tiles import find_unbuilt, read_tiles

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_cloud.query.neighbourhood import ChannelSource
    from eskin_cloud.rollup.aggregates import Integers


class TileVerdict(IntEnum):
    """The verdict of a tile."""

    NOT_ABOVE = 0
    OPEN = 1
    ABOVE = 2
    EMPTY = 3
    CHANGED = 4


@dataclass(frozen=True, slots=True)
class TileBounds:
    """Neighbouring tiles of a channel, by number.

    Attributes:
        good: Whether samples within ``lo`` and ``hi`` are valid throughout each tile; decided by
            the tile and both neighbours.
        empty: Whether neither the tile nor its neighbours hold a sample.
        changed: Whether the whole tile must be read from samples.
        lo: Least lower bound of a tile and its neighbours.
        hi: Greatest upper bound.
        n: Samples in each tile, and in the neighbours of the first and the last.
        coverage: The least of all these samples.
    """

    good: NDArray[np.bool_]
    empty: NDArray[np.bool_]
    changed: NDArray[np.bool_]
    lo: Floats
    hi: Floats
    n: Integers
    coverage: float


def read_grid(source: ChannelSource, level: int, first: int, end: int) -> TileBounds:
    """Read some tiles of a level, from ``first`` up to, and without, ``end``."""
    numbers = np.arange(first - 1, end + 1, dtype=np.int64)
    ranges = [(first - 1, end + 1)]
    pieces = read_tiles(source.connection, source.channel, level, ranges)
    at = (pieces.first >> level) - (first - 1)
    opened, changed = _find_changed(source, level, numbers)
    full = np.zeros(numbers.size, np.bool_)
    full[at] = True
    lo, hi = np.full(numbers.size, -np.inf), np.full(numbers.size, np.inf)
    lo[at], hi[at] = pieces.lo, pieces.hi
    columns = np.zeros((6, numbers.size), np.int64)
    columns[:, at] = (
        *(pieces.first, pieces.last, pieces.dt),
        *(pieces.breaks, pieces.error, pieces.n),
    )
    begun, last, dt, breaks, error, n = columns
    whole = full & ~opened & (breaks == 0)
    linked = begun[1:] - last[:-1] <= longest_step(dt[:-1])
    good = whole[:-2] & whole[1:-1] & whole[2:] & linked[:-1] & linked[1:]
    good &= begun[:-2] - (numbers[1:-1] << level) <= -error[:-2]
    good &= last[2:] - (numbers[2:] << level) >= error[2:]
    none = ~full & ~opened
    return TileBounds(
        good=good,
        empty=none[:-2] & none[1:-1] & none[2:],
        changed=changed[1:-1],
        lo=np.minimum(np.minimum(lo[:-2], lo[1:-1]), lo[2:]),
        hi=np.maximum(np.maximum(hi[:-2], hi[1:-1]), hi[2:]),
        n=n,
        coverage=float(pieces.coverage.min(initial=1.0)),
    )


def _find_changed(
    source: ChannelSource, level: int, numbers: Integers
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether samples must be read in a part of a tile, and in all of it."""
    within = int(numbers[0]) << level, (int(numbers[-1]) + 1) << level
    touched = np.zeros((2, numbers.size + 1), np.int64)
    for start, end in find_unbuilt(source.connection, source.channel, within):
        some = (start >> level) - numbers[0], -(-end >> level) - numbers[0]
        every = -(-start >> level) - numbers[0], (end >> level) - numbers[0]
        for row, (begin, stop) in zip(touched, (some, every), strict=True):
            if begin < stop:
                row[begin] += 1
                row[stop] -= 1
    opened, changed = np.cumsum(touched, axis=1)[:, :-1] > 0
    return opened, changed


def classify(one: TileBounds, other: TileBounds) -> Iterator[tuple[TileVerdict, int, int, int]]:
    """Runs of tiles with one verdict: verdict, first, end, and number of samples."""
    fates = np.full(one.good.size, TileVerdict.OPEN, np.int8)
    good = one.good & other.good
    fates[good & (one.lo > other.hi)] = TileVerdict.ABOVE
    fates[good & (one.hi <= other.lo)] = TileVerdict.NOT_ABOVE
    fates[one.changed | other.changed] = TileVerdict.CHANGED
    fates[one.empty | other.empty] = TileVerdict.EMPTY
    cut = np.flatnonzero(np.diff(fates, prepend=-1))
    ends = np.append(cut[1:], fates.size)
    total = np.concatenate([[0], np.cumsum(one.n + other.n)])
    samples = total[ends + 2] - total[cut]
    rows = zip(cut.tolist(), ends.tolist(), samples.tolist(), strict=True)
    for (begin, stop, n), fate in zip(rows, fates[cut].tolist(), strict=True):
        yield TileVerdict(fate), begin, stop, n
