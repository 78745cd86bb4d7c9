"""A search for peaks goes on where it stood when a node leaves a fleet's columns, ties included."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.firmware.channel import Baseline, Smoothing
from eskin_sensor_node.firmware.peaks import PeakDetector
from eskin_sensor_node.fleet.columns import fresh

from eskin.peaks import Peaks
from eskin.peaks.certain_possible_peaks import MOST_AT_ONCE, search
from eskin.peaks.table import EVENT

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.fleet.columns import Columns

LONGEST = 4
Bound = tuple[float, ...]


def unit_of(detector: PeakDetector) -> Any:
    """As much of a channel's unit as the columns take."""
    return SimpleNamespace(
        baseline=Baseline(),
        smoothing=Smoothing(0.0),
        detector=detector,
        silent=0,
        calibrating=False,
        first=0,
        since=0,
    )


def stated(events: Sequence[Any]) -> list[tuple[Any, ...]]:
    return [(int(e.verdict), e.first, e.last, e.count, e.height, e.prominence) for e in events]


def by_columns(columns: Columns, lows: Bound, highs: Bound, prominence: float) -> list[Any]:
    """The fleet's search."""
    events = np.zeros(len(lows) + MOST_AT_ONCE, EVENT)
    lo, hi = np.array(lows), np.array(highs)
    state = columns.progress[0], columns.passes[0, 0], columns.regions[0, 0]
    taken, count = search(lo, hi, prominence, *state, events)
    assert taken == len(lows)
    return stated(Peaks(events[:count]))


def whole(lows: Bound, highs: Bound, prominence: float) -> list[Any]:
    """The firmware's search, by itself."""
    detector = PeakDetector(prominence, LONGEST)
    return stated([*detector.feed(lows, highs, len(lows)), *detector.gap(0)])


def moved(lows: Bound, highs: Bound, prominence: float, cuts: tuple[int, int]) -> list[Any]:
    """The firmware's search up to the first cut, the fleet's to the second, then the firmware's."""
    begin, end = cuts
    detector = PeakDetector(prominence, LONGEST)
    found = stated(detector.feed(lows[:begin], highs[:begin], begin))
    columns = fresh(1, 1, LONGEST)
    columns.store(0, 0, unit_of(detector), 0)
    found += by_columns(columns, lows[begin:end], highs[begin:end], prominence)
    detector = PeakDetector(prominence, LONGEST)
    columns.load(0, 0, unit_of(detector), end)
    found += stated(detector.feed(lows[end:], highs[end:], len(lows) - end))
    return found + stated(detector.gap(0))


@pytest.mark.parametrize(("length", "heights"), [(5, 2), (4, 3), (7, 1)])
def test_search_goes_on_in_columns_and_out_of_them(length: int, heights: int) -> None:
    """Every small tube of integers; one height more where it is thin."""
    ranges = [(lo, hi) for lo in range(heights) for hi in range(lo, heights)]
    if heights == 1:
        ranges = [(0, 0), (1, 1)]
    for tube in itertools.product(ranges, repeat=length):
        lows, highs = (tuple(float(pair[side]) for pair in tube) for side in (0, 1))
        expected = whole(lows, highs, 1.0)
        for cuts in itertools.combinations_with_replacement(range(length + 1), 2):
            assert moved(lows, highs, 1.0, cuts) == expected, (tube, cuts)
