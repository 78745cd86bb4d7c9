"""Read the samples of a channel as aggregates: one for each sample, or for each bucket."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin_cloud.rollup.aggregates import EMPTY, Aggregates, concatenated
from eskin_cloud.store.read.patch_columns import read_column, split_column
from eskin_cloud.store.read.window import Window, clip

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sqlalchemy import Connection

    from eskin.interval import Floats
    from eskin_cloud.rollup.buckets import Buckets
    from eskin_cloud.store.read.lookup import Channel
    from eskin_cloud.store.read.patch_columns import ColumnRun

_FACTOR: Final = 8
"""A part of a window is so many times as long as the one before it."""


def read_samples(connection: Connection, channel: Channel, window: Window) -> Aggregates:
    """One entry for each sample in a window."""
    return _apart(read_column(connection, channel, window), window)


def read_few(
    connection: Connection, channel: Channel, window: Window, most: int
) -> Aggregates | None:
    """One entry for each sample in a window; ``None`` if there are more than ``most``."""
    found, count = [], 0
    for some in _widening(window, most * channel["dt"]):
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


def _apart(runs: Sequence[ColumnRun], window: Window) -> Aggregates:
    """One entry for each sample of some runs in a window, in order of time."""
    if not runs:
        return EMPTY
    n = [run.lo.size for run in runs]
    begun, dt, error = (
        np.repeat(np.array(each, np.int64), n)
        for each in zip(*((run.t, run.dt, run.error) for run in runs), strict=True)
    )
    t = begun + dt * np.concatenate([np.arange(each, dtype=np.int64) for each in n])
    none = np.zeros(t.size, np.int64)
    bounds, coverage = _bounds(runs), np.repeat([run.coverage for run in runs], n)
    pieces = Aggregates(t, t, none + 1, none, dt, none, error, *bounds, *bounds, coverage)
    order = np.flatnonzero((t >= window.start) & (t < window.end))
    if np.any(np.diff(t[order]) < 0):
        order = order[np.lexsort((begun[order], t[order]))]
    return pieces[order]


def _fold(runs: Sequence[ColumnRun], window: Window, buckets: Buckets) -> Aggregates:
    """One entry for each bucket with samples of some runs in a window."""
    if not runs:
        return EMPTY
    if any(after.t < run.t + run.dt * (run.lo.size - 1) for run, after in pairwise(runs)):
        samples = _apart(runs, window)  # runs overlap
        return samples.grouped(buckets.of(samples.first))
    rows, place = [], 0
    for run in runs:
        first, last = clip(run.t, run.dt, run.lo.size, window)
        rows.append((run.t + run.dt * first, run.dt, last - first + 1, place + first, run.error))
        place += run.lo.size
    coverage = np.array([run.coverage for run in runs])
    grid = buckets.start, buckets.width
    return Aggregates.of_samples(_bounds(runs), np.array(rows), coverage, grid, buckets.count)


def _bounds(runs: Sequence[ColumnRun]) -> tuple[Floats, Floats]:
    return np.concatenate([run.lo for run in runs]), np.concatenate([run.hi for run in runs])
