"""The search in one compiled loop: both passes, and the regions between them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.kernels.jit import inlined, kernel
from eskin.peaks.hysteresis import begin, completes, follow, include, nowhere, rest, wake
from eskin.peaks.region import (
    MOST_REGIONS,
    match,
    remember,
    report,
    report_certain,
    report_closed,
)

if TYPE_CHECKING:
    from eskin.interval import Floats

PROGRESS: Final = np.dtype([("index", np.int64), ("waiting", np.int64), ("longest", np.int64)])
"""Samples so far, gaps included; regions that wait; samples that they may wait."""
MOST_AT_ONCE: Final = MOST_REGIONS + 2
"""Events that one sample can decide."""


@inlined
def is_interval(lo: float, hi: float) -> bool:
    """Whether bounds are those of an interval that is not empty, nor only infinity."""
    return hi - lo >= 0.0


@inlined
def is_missing(lo: float, hi: float) -> bool:
    """Whether a bound is NaN."""
    return lo != lo or hi != hi  # noqa: PLR0124


@kernel
def search(
    lows: Floats, highs: Floats, prominence: float, at: Any, passes: Any, regions: Any, events: Any
) -> tuple[int, int]:
    """Take samples until they end, or the events have no room left, or bounds are no interval.

    Args:
        lows: Lower bounds; a bound is NaN where a sample is missing.
        highs: Upper bounds, as many.
        prominence: Least prominence.
        at: Where the search stands, one row in `PROGRESS`.
        passes: The certain pass and the optimistic pass at rest, in `PASS`.
        regions: Room for one more than `MOST_REGIONS`, in `REGION`.
        events: Room for events, in `eskin.peaks.table.EVENT`.

    Returns:
        How many samples were taken, and how many events were written.
    """
    certain, optimistic = wake(passes[0]), wake(passes[1])
    start, waiting, longest = at[0].index, at[0].waiting, at[0].longest
    taken = count = 0
    while taken < lows.size and count + MOST_AT_ONCE <= events.size:
        lo, hi, index = lows[taken], highs[taken], start + taken
        if is_interval(lo, hi):
            optimistic = include(optimistic, lo, hi)
            if completes(optimistic, lo, prominence):
                waiting = remember(regions, waiting, optimistic, index)
                optimistic = begin(index, lo, lo, hi)
            else:
                optimistic = follow(optimistic, index, lo, hi, lo, hi, prominence)
            certain, growing, oldest = include(certain, lo, hi), optimistic.first, index - longest
            if completes(certain, hi, prominence):
                waiting = match(regions, waiting, certain.first)
                waiting, count = report_closed(
                    regions, waiting, oldest, index, growing, events, count
                )
                count = report_certain(certain, index, hi, events, count)
                certain = begin(index, hi, lo, hi)
            else:
                certain = follow(certain, index, hi, lo, lo, hi, prominence)
                first = certain.first
                waiting, count = report_closed(
                    regions, waiting, oldest, first, growing, events, count
                )
        elif is_missing(lo, hi):
            waiting, count = report(regions, waiting, waiting, events, count)
            certain = optimistic = nowhere()
        else:
            break
        taken += 1
    rest(certain, passes[0])
    rest(optimistic, passes[1])
    at[0].index, at[0].waiting = start + taken, waiting
    return taken, count
