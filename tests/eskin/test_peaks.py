"""The peaks of a tube bracket those of every signal inside it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import find_peaks as scipy_find_peaks

from eskin.peaks import PeakDetector, PeakEvent, Verdict, find_peaks

SIGNAL = st.lists(st.floats(-10, 10, width=16), min_size=1, max_size=60)
RADII = st.lists(st.floats(0, 3, width=16), min_size=60, max_size=60)


def counts(events: list[PeakEvent]) -> tuple[int, int]:
    return sum(e.count[0] for e in events), sum(e.count[1] for e in events)


@given(signal=SIGNAL, radii=RADII, where=st.integers(0, 2**32 - 1), p=st.floats(0.25, 6, width=16))
def test_counts_bracket_scipy_for_any_signal_inside(
    signal: list[float], radii: list[float], where: int, p: float
) -> None:
    middle = np.array(signal)
    radius = np.array(radii[: len(signal)])
    lo, hi = middle - radius, middle + radius
    inside = np.clip(np.random.default_rng(where).uniform(lo, hi), lo, hi)
    fewest, most = counts(find_peaks(lo, hi, prominence=p))
    found = len(scipy_find_peaks(inside, prominence=p)[0])
    assert fewest <= found <= most


@given(steps=st.permutations(range(1, 40)), p=st.floats(0.5, 20, width=16))
def test_thin_tube_agrees_with_scipy(steps: list[int], p: float) -> None:
    signal = np.array(steps, dtype=float)
    events = find_peaks(signal, signal, prominence=p)
    indices, _ = scipy_find_peaks(signal, prominence=p)
    assert [e.verdict for e in events] == [Verdict.CERTAIN] * len(indices)
    for event, index in zip(events, indices, strict=True):
        assert event.first < index < event.last
        assert event.height == (signal[index], signal[index])


@given(signal=SIGNAL, radii=RADII, p=st.floats(0.25, 6, width=16), cut=st.integers(0, 60))
def test_streaming_in_pieces_equals_the_whole(
    signal: list[float], radii: list[float], p: float, cut: int
) -> None:
    lo = [x - r for x, r in zip(signal, radii, strict=False)]
    hi = [x + r for x, r in zip(signal, radii, strict=False)]
    detector = PeakDetector(p)
    pieces = [*detector.feed(lo[:cut], hi[:cut]), *detector.feed(lo[cut:], hi[cut:])]
    assert [*pieces, *detector.finish()] == find_peaks(lo, hi, prominence=p)


@given(signal=SIGNAL, radii=RADII, where=st.integers(0, 2**32 - 1), p=st.floats(0.25, 6, width=16))
def test_certain_peak_holds_its_height_and_prominence_for_a_signal_inside(
    signal: list[float], radii: list[float], where: int, p: float
) -> None:
    middle = np.array(signal)
    radius = np.array(radii[: len(signal)])
    lo, hi = middle - radius, middle + radius
    inside = np.clip(np.random.default_rng(where).uniform(lo, hi), lo, hi)
    for event in find_peaks(lo, hi, prominence=p):
        piece = inside[event.first : event.last + 1]
        top = int(np.argmax(piece))
        assert event.height[0] <= piece[top] <= event.height[1]
        if event.verdict is Verdict.CERTAIN:
            shown = piece[top] - max(piece[:top].min(), piece[top + 1 :].min())
            assert p <= shown
            assert event.prominence[0] <= shown <= event.prominence[1]


def test_tube_wider_than_prominence_is_one_region() -> None:
    events = find_peaks([0.0] * 100, [5.0] * 100, prominence=1.0)
    assert len(events) == 1
    assert events[0].verdict is Verdict.POSSIBLE
    assert events[0].count == (0, 49)


def test_longest_region_reports_an_undecided_stretch_in_time() -> None:
    detector = PeakDetector(1.0, longest_region=20)
    events = detector.feed([0.0] * 100, [5.0] * 100)
    assert len(events) == 4
    assert all(e.last - e.first <= 20 for e in events)


@given(
    signal=SIGNAL,
    radii=RADII,
    where=st.integers(0, 2**32 - 1),
    p=st.floats(0.25, 6, width=16),
    longest=st.integers(2, 30),
)
def test_longest_region_keeps_certain_ones_exact_and_bounds_all(
    signal: list[float], radii: list[float], where: int, p: float, longest: int
) -> None:
    middle = np.array(signal)
    radius = np.array(radii[: len(signal)])
    lo, hi = middle - radius, middle + radius
    inside = np.clip(np.random.default_rng(where).uniform(lo, hi), lo, hi)
    detector = PeakDetector(p, longest_region=longest)
    events = [*detector.feed(lo, hi), *detector.finish()]
    whole = find_peaks(lo, hi, prominence=p)
    certain = [e for e in events if e.verdict is Verdict.CERTAIN]
    assert certain == [e for e in whole if e.verdict is Verdict.CERTAIN]
    found = len(scipy_find_peaks(inside, prominence=p)[0])
    assert counts(events)[0] <= found <= counts(events)[1]


def test_gap_joins_nothing_across() -> None:
    detector = PeakDetector(1.0)
    before = detector.feed([0.0, 5.0], [0.0, 5.0])
    across = detector.gap(samples=3)
    after = detector.feed([5.0, 0.0, 5.0, 0.0], [5.0, 0.0, 5.0, 0.0])
    assert before + across == []
    assert [(e.first, e.last) for e in after] == [(6, 8)]


def test_exact_tie_counts_as_reaching_the_prominence() -> None:
    assert counts(find_peaks([0.0, 1.0, 0.0], [0.0, 1.0, 0.0], prominence=1.0)) == (1, 1)


def test_difference_that_only_rounds_to_the_prominence_is_no_certain_peak() -> None:
    low = 2.0**-60
    signal = [low, 1.0, low]
    assert counts(find_peaks(signal, signal, prominence=1.0)) == (0, 0)


@pytest.mark.parametrize("prominence", [0.0, -1.0, float("inf"), float("nan")])
def test_prominence_that_is_not_positive_is_refused(prominence: float) -> None:
    with pytest.raises(ValueError, match="prominence must be positive"):
        PeakDetector(prominence)
