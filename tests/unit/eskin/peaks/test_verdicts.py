"""The peaks of a tube bracket those of every signal inside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.signal import find_peaks as scipy_find_peaks

from eskin.interval import Verdict
from eskin.peaks import PeakEvent, PeakStream, find_peaks

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

SIGNAL = st.lists(st.floats(-10, 10, width=16), min_size=1, max_size=60)
RADII = st.lists(st.floats(0, 3, width=16), min_size=60, max_size=60)


def without_ties(signal: NDArray[np.float64]) -> bool:
    """scipy counts each of several equally high peaks as if the others were lower: `test_ties`."""
    return len(set(signal.tolist())) == len(signal)


def counts(events: Iterable[PeakEvent]) -> tuple[int, int]:
    return sum(e.count[0] for e in events), sum(e.count[1] for e in events)


@given(signal=SIGNAL, radii=RADII, where=st.integers(0, 2**32 - 1), p=st.floats(0.25, 6, width=16))
def test_counts_bracket_scipy_for_any_signal_inside(
    signal: list[float], radii: list[float], where: int, p: float
) -> None:
    middle = np.array(signal)
    radius = np.array(radii[: len(signal)])
    lo, hi = middle - radius, middle + radius
    inside = np.clip(np.random.default_rng(where).uniform(lo, hi), lo, hi)
    assume(without_ties(inside))
    fewest, most = counts(find_peaks(lo, hi, prominence=p))
    found = len(scipy_find_peaks(inside, prominence=p)[0])
    assert fewest <= found <= most


@given(
    signal=SIGNAL,
    radii=RADII,
    where=st.integers(0, 2**32 - 1),
    p=st.floats(0.25, 6, width=16),
    kinds=st.lists(st.sampled_from(["both", "no lo", "no hi", "none", "missing"]), max_size=60),
)
def test_counts_bracket_scipy_with_unbounded_sides_and_gaps(
    signal: list[float], radii: list[float], where: int, p: float, kinds: list[str]
) -> None:
    middle = np.array(signal)
    radius = np.array(radii[: len(signal)])
    kind = np.array((kinds + ["both"] * len(signal))[: len(signal)])
    lo = np.where(np.isin(kind, ["no lo", "none"]), -20.0, middle - radius)
    hi = np.where(np.isin(kind, ["no hi", "none"]), 20.0, middle + radius)
    inside = np.clip(np.random.default_rng(where).uniform(lo, hi), lo, hi)
    assume(without_ties(inside))
    lo[lo == -20.0], hi[hi == 20.0] = -np.inf, np.inf
    missing = kind == "missing"
    lo[missing] = hi[missing] = np.nan
    fewest, most = find_peaks(lo, hi, prominence=p).total
    inside[missing] = np.nan
    parts = np.split(inside, np.flatnonzero(missing))
    known = [part[~np.isnan(part)] for part in parts]
    found = sum(len(scipy_find_peaks(part, prominence=p)[0]) for part in known)
    assert fewest <= found <= most


@given(
    signal=st.lists(st.floats(-10, 10, width=16), unique=True, min_size=3, max_size=80),
    p=st.floats(0.125, 6, width=16),
)
def test_thin_tube_counts_what_scipy_counts(signal: list[float], p: float) -> None:
    found = len(scipy_find_peaks(np.array(signal), prominence=p)[0])
    assert find_peaks(signal, signal, prominence=p).total == (found, found)


@pytest.mark.parametrize("kind", ["noise", "sine with noise", "random walk"])
@pytest.mark.parametrize("p", [0.01, 0.5, 3.0])
def test_long_thin_tube_has_scipys_peaks(kind: str, p: float) -> None:
    noise = np.random.default_rng(1).normal(size=100_000)
    signal = {
        "noise": noise,
        "sine with noise": np.sin(np.arange(100_000) / 500) + 0.1 * noise,
        "random walk": noise.cumsum(),
    }[kind]
    table = find_peaks(signal, signal, prominence=p).table
    indices, _ = scipy_find_peaks(signal, prominence=p)
    assert len(table) == len(indices)
    assert np.all((table["first"] < indices) & (indices < table["last"]))
    assert np.array_equal(table["height_inf"], signal[indices])


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
    stream = PeakStream(p)
    pieces = [*stream.feed(lo[:cut], hi[:cut]), *stream.feed(lo[cut:], hi[cut:])]
    assert [*pieces, *stream.finish()] == list(find_peaks(lo, hi, prominence=p))


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
    stream = PeakStream(1.0, longest_region=20)
    events = stream.feed([0.0] * 100, [5.0] * 100)
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
    assume(without_ties(inside))
    stream = PeakStream(p, longest_region=longest)
    events = [*stream.feed(lo, hi), *stream.finish()]
    whole = find_peaks(lo, hi, prominence=p)
    certain = [e for e in events if e.verdict is Verdict.CERTAIN]
    assert certain == [e for e in whole if e.verdict is Verdict.CERTAIN]
    found = len(scipy_find_peaks(inside, prominence=p)[0])
    assert counts(events)[0] <= found <= counts(events)[1]


def test_gap_joins_nothing_across() -> None:
    stream = PeakStream(1.0)
    before = stream.feed([0.0, 5.0], [0.0, 5.0])
    across = stream.gap(samples=3)
    after = stream.feed([5.0, 0.0, 5.0, 0.0], [5.0, 0.0, 5.0, 0.0])
    assert not before
    assert not across
    assert [(e.first, e.last) for e in after] == [(6, 8)]


def test_exact_tie_counts_as_reaching_the_prominence() -> None:
    assert counts(find_peaks([0.0, 1.0, 0.0], [0.0, 1.0, 0.0], prominence=1.0)) == (1, 1)


def test_difference_that_only_rounds_to_the_prominence_is_no_certain_peak() -> None:
    low = 2.0**-60
    signal = [low, 1.0, low]
    assert counts(find_peaks(signal, signal, prominence=1.0)) == (0, 0)
