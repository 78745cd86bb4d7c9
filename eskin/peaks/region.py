"""Peaks that are undecided yet, compiled: they wait in regions until nothing can claim them.

There are few, so that memory is constant: with one too many, the two oldest melt into one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.interval import Verdict
from eskin.kernels.jit import inlined
from eskin.kernels.outward_rounding import next_down, next_up

if TYPE_CHECKING:
    from eskin.peaks.hysteresis import Pass

MOST_REGIONS: Final = 8
REGION: Final = np.dtype(
    [
        ("first", np.int64),
        ("last", np.int64),
        ("peaks", np.int64),
        ("lowest", np.float64),
        ("floor", np.float64),
        ("ceiling", np.float64),
    ]
)
"""A stretch of samples with a number of possible peaks in it."""
_CERTAIN: Final = int(Verdict.CERTAIN)
_POSSIBLE: Final = int(Verdict.POSSIBLE)


@inlined
def remember(regions: Any, waiting: int, span: Pass, last: int) -> int:
    """Let a possible peak wait: with the youngest region if they touch; gives how many wait."""
    if waiting > 0 and span.first <= regions[waiting - 1].last:
        extend(regions[waiting - 1], last, 1, span.lowest, span.floor, span.ceiling)
        return waiting
    place = regions[waiting]
    place.first, place.last, place.peaks = span.first, last, 1
    place.lowest, place.floor, place.ceiling = span.lowest, span.floor, span.ceiling
    if waiting < MOST_REGIONS:
        return waiting + 1
    second = regions[1]
    extend(regions[0], second.last, second.peaks, second.lowest, second.floor, second.ceiling)
    return drop(regions, waiting + 1, 1)


@inlined
def extend(region: Any, last: int, peaks: int, lowest: float, floor: float, ceiling: float) -> None:
    """A region takes in what comes after it."""
    region.last = last
    region.peaks += peaks
    region.lowest = min(region.lowest, lowest)
    region.floor = max(region.floor, floor)
    region.ceiling = max(region.ceiling, ceiling)


@inlined
def drop(regions: Any, waiting: int, place: int) -> int:
    """Remove one region; gives how many are left."""
    for k in range(place, waiting - 1):
        regions[k] = regions[k + 1]
    return waiting - 1


@inlined
def match(regions: Any, waiting: int, first: int) -> int:
    """Take a peak that proved certain out of the highest region that reaches beyond its first.

    There always is one, unless it was reported as possible before, for taking too long.
    """
    best = -1
    for k in range(waiting):
        if regions[k].last > first and (best < 0 or regions[k].ceiling > regions[best].ceiling):
            best = k
    if best < 0:
        return waiting
    regions[best].peaks -= 1
    return drop(regions, waiting, best) if regions[best].peaks == 0 else waiting


@inlined
def report_closed(
    regions: Any,
    waiting: int,
    oldest: int,
    certain_first: int,
    growing_first: int,
    events: Any,
    count: int,
) -> tuple[int, int]:
    """Report regions that no certain peak can claim any more, and that will not grow.

    All are reported if the first begins at sample ``oldest`` or before.

    Returns:
        How many still wait, and how many events there are.
    """
    if waiting == 0:
        return 0, count
    number = waiting if regions[0].first <= oldest else 0
    while (
        number < waiting
        and regions[number].last <= certain_first
        and regions[number].last < growing_first
    ):
        number += 1
    return report(regions, waiting, number, events, count) if number else (waiting, count)


@inlined
def report(regions: Any, waiting: int, number: int, events: Any, count: int) -> tuple[int, int]:
    """Write the oldest regions down; gives how many still wait, and how many events there are."""
    for k in range(number):
        region, event = regions[k], events[count + k]
        event.verdict = _POSSIBLE
        event.first, event.last = region.first, region.last
        event.fewest, event.most = 0, region.peaks
        event.height_inf, event.height_sup = region.floor, region.ceiling
        event.prominence_inf = 0.0
        event.prominence_sup = next_up(region.ceiling - region.lowest)
    for k in range(number, waiting):
        regions[k - number] = regions[k]
    return waiting - number, count + number


@inlined
def report_certain(span: Pass, last: int, valley: float, events: Any, count: int) -> int:
    """Write a certain peak down, which ends in a valley; gives how many events there are."""
    event = events[count]
    event.verdict = _CERTAIN
    event.first, event.last = span.first, last
    event.fewest, event.most = 1, 1
    event.height_inf, event.height_sup = span.floor, span.ceiling
    event.prominence_inf = next_down(span.crest - max(span.valley, valley))
    event.prominence_sup = next_up(span.ceiling - span.lowest)
    return count + 1
