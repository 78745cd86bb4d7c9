"""Read the samples of a channel as aggregates: one for each sample, or for each bucket."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin_cloud.rollup.aggregates import EMPTY, Aggregates, concatenated
from eskin_cloud.store.read.patch_columns import read_column, split_column
from eskin_cloud.store.read.window import Window

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sqlalchemy import Connection

    from eskin_cloud.rollup.buckets import Buckets
    from eskin_cloud.store.column_runs import ColumnRuns
    from eskin_cloud.store.read.lookup import Channel

_FACTOR: Final = 8
"""A part of a window is so many times as long as the one before it."""


def read_samples(connection: Connection, channel: Channel, *windows: Window) -> Aggregates:
    """One entry for each sample in some windows, which are in order of time and disjoint."""
    return _apart(read_column(connection, channel, *windows), windows)


def read_few(
    connection: Connection, channel: Channel, window: Window, most: int
) -> Aggregates | None:
    """One entry for each sample in a window; ``None`` if there are more than ``most``."""
    found, count = [], 0
    for some in _widening(window, (most + most // 4) * max(channel["dt"], 1)):
        for part in split_column(connection, channel, some):
            found.append(read_samples(connection, channel, part))
            count += len(found[-1])
            if count > most:
                return None
    return concatenated(found)


def _widening(window: Window, span: int) -> Iterator[Window]:
    """Split a window into parts of about ``span`` ns at first, each far longer than the last.

    So a dense window is known to hold too much from its beginning alone.
    """
    at = window.start
    while at < window.end:
        end = min(at + span, window.end)
        yield Window(at, end)
        at, span = end, _FACTOR * span


def read_buckets(
    connection: Connection, channel: Channel, window: Window, buckets: Buckets
) -> Aggregates:
    """One entry for each bucket with samples in a window."""
    parts = split_column(connection, channel, window)
    folded = concatenated(
        [_fold(read_column(connection, channel, part), part, buckets) for part in parts]
    )
    return folded.grouped(buckets.of(folded.first))


def _apart(runs: ColumnRuns, windows: Sequence[Window]) -> Aggregates:
    """One entry for each sample of some runs in some windows, in order of time."""
    if not len(runs):
        return EMPTY
    n = runs.n
    begun, dt, error = (np.repeat(each, n) for each in (runs.t, runs.dt, runs.error))
    within = np.arange(begun.size) - np.repeat(np.cumsum(n) - n, n)
    t = begun + dt * within
    none = np.zeros(t.size, np.int64)
    bounds, coverage = (runs.lo, runs.hi), np.repeat(runs.coverage, n)
    pieces = Aggregates(t, t, none + 1, none, dt, error, *bounds, *bounds, coverage)
    ends = np.array([(each.start, each.end) for each in windows], np.int64)
    window = np.searchsorted(ends[:, 0], t, side="right") - 1
    order = np.flatnonzero((window >= 0) & (t < ends[window, 1]))
    if np.any(np.diff(t[order]) < 0):
        order = order[np.lexsort((begun[order], t[order]))]
    return pieces[order]


def _fold(runs: ColumnRuns, window: Window, buckets: Buckets) -> Aggregates:
    """One entry for each bucket with samples of some runs in a window."""
    if not len(runs):
        return EMPTY
    if np.any(runs.t[1:] < (runs.t + runs.dt * (runs.n - 1))[:-1]):
        samples = _apart(runs, [window])  # runs overlap
        return samples.grouped(buckets.of(samples.first))
    first, last = runs.clipped(window.start, window.end)
    begin = np.cumsum(runs.n) - runs.n
    rows = (runs.t + runs.dt * first, runs.dt, last - first + 1, begin + first, runs.error)
    grid = buckets.start, buckets.width
    bounds = runs.lo, runs.hi
    return Aggregates.of_samples(bounds, np.stack(rows, axis=1), runs.coverage, grid, buckets.count)
