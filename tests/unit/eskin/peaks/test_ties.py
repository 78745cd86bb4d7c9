"""What a peak is where heights are equal: all small integer signals and tubes, by brute force."""

from __future__ import annotations

import itertools
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.signal import find_peaks as scipy_find_peaks

from eskin.peaks import PeakStream, find_peaks
from tests.unit.eskin.peaks.firmware import Detector

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from eskin.peaks import PeakEvent

Signal = tuple[int, ...]


@cache
def peaks_of(signal: Signal, prominence: int) -> int:
    """The definition: most b with samples a before and c after it that lie so much lower.

    ``a < b < c``; the c of one peak may be the a of the next. Tries every choice.
    """
    before = [0] * len(signal)  # most peaks that end in a valley at or before k
    for c in range(len(signal)):
        before[c] = before[c - 1] if c else 0
        for a, b in itertools.combinations(range(c), 2):
            if signal[b] - max(signal[a], signal[c]) >= prominence:
                before[c] = max(before[c], before[a] + 1)
    return max(before, default=0)


def counted(events: Iterable[PeakEvent]) -> tuple[int, int]:
    found = [event.count for event in events]
    return sum(fewest for fewest, _ in found), sum(most for _, most in found)


def by_all(lo: Sequence[int], hi: Sequence[int], prominence: int) -> tuple[int, int]:
    """Fewest and most, as firmware, library and a stream of single samples agree on them."""
    lows, highs = [float(x) for x in lo], [float(x) for x in hi]
    detector, stream = Detector(float(prominence)), PeakStream(prominence)
    firmware = [*detector.feed(lows, highs), *detector.finish()]
    pieces = [
        e for each in zip(lows, highs, strict=True) for e in stream.feed(*([x] for x in each))
    ]
    library = list(find_peaks(lows, highs, prominence=prominence))
    assert repr(firmware) == repr(library) == repr([*pieces, *stream.finish()])
    return counted(library)


@pytest.mark.parametrize(
    "length",
    [*range(6), *(pytest.param(length, marks=pytest.mark.nightly) for length in (6, 7))],
)
def test_thin_tube_has_the_peaks_of_its_signal(length: int) -> None:
    for signal in itertools.product(range(4 if length < 7 else 3), repeat=length):
        for prominence in (1, 2, 3):
            count = peaks_of(signal, prominence)
            assert by_all(signal, signal, prominence) == (count, count), signal


@pytest.mark.parametrize(("length", "heights"), [(1, 4), (2, 4), (3, 4), (4, 3), (5, 3), (7, 2)])
def test_counts_are_the_fewest_and_the_most_of_all_signals_inside(
    length: int, heights: int
) -> None:
    ranges = [(lo, hi) for lo in range(heights) for hi in range(lo, heights)]
    for tube in itertools.product(ranges, repeat=length):
        inside = list(itertools.product(*(range(lo, hi + 1) for lo, hi in tube)))
        for prominence in range(1, heights):
            counts = [peaks_of(signal, prominence) for signal in inside]
            found = by_all([lo for lo, _ in tube], [hi for _, hi in tube], prominence)
            assert found == (min(counts), max(counts)), tube


@pytest.mark.parametrize("later", ["lower", "higher"])
def test_scipy_counts_as_many_once_ties_are_broken(later: str) -> None:
    slope = 1e-3 if later == "higher" else -1e-3
    for signal in itertools.product(range(4), repeat=6):
        apart = np.array(signal) + slope * np.arange(6)
        for prominence in (1, 2, 3):
            found = len(scipy_find_peaks(apart, prominence=prominence - 0.5)[0])
            assert peaks_of(signal, prominence) == found, signal


def test_scipy_counts_equal_summits_one_by_one() -> None:
    for signal in itertools.product(range(4), repeat=6):
        for prominence in (1, 2, 3):
            found = len(scipy_find_peaks(np.array(signal), prominence=prominence)[0])
            assert peaks_of(signal, prominence) <= found, signal
    twins = [0.0, 3.0, 2.0, 3.0, 0.0]
    assert len(scipy_find_peaks(twins, prominence=3)[0]) == 2
    (one,) = find_peaks(twins, twins, prominence=3)
    assert (one.first, one.last, one.height, one.count) == (0, 4, (3.0, 3.0), (1, 1))
    assert find_peaks(twins, twins, prominence=1).total == (2, 2)


@pytest.mark.parametrize(
    ("signal", "count"),
    [
        ([0, 2, 2, 2, 0], 1),  # a plateau is one summit
        ([0, 2, 2], 0),  # the end is no valley
        ([2, 2, 0, 2, 2], 0),
        ([1, 1, 1], 0),
        ([0, 2, 1, 2, 0, 0, 2, 0], 2),  # a dip of less than p divides nothing
        ([0, 1, 2, 1, 0, 2, 0], 2),  # the c of one is the a of the next
    ],
)
def test_plateaus_ends_and_shallow_dips(signal: list[int], count: int) -> None:
    assert by_all(signal, signal, 2) == (count, count)
    assert peaks_of(tuple(signal), 2) == count
