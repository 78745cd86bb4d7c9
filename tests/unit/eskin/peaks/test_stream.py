"""The compiled search gives the events of the firmware's, bit for bit."""

from __future__ import annotations

import itertools
from math import inf, nan
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import eskin
from eskin.peaks import PeakEvent, Peaks, PeakStream, find_peaks
from eskin.peaks.certain_possible_peaks import MOST_AT_ONCE, search
from eskin.peaks.table import EVENT
from tests.unit.eskin.peaks.firmware import Detector
from tests.unit.eskin.peaks.tubes import ADVERSARIAL, PROMINENCES, Sample

if TYPE_CHECKING:
    from collections.abc import Iterable

LONGEST = st.one_of(st.none(), st.integers(1, 40))
CUTS = st.lists(st.integers(0, 200), max_size=6)


def columns(samples: list[Sample]) -> tuple[list[float], list[float]]:
    return [lo for lo, _ in samples], [hi for _, hi in samples]


def exactly(events: Iterable[PeakEvent]) -> list[str]:
    """Every bit, the sign of zero too."""
    return [repr(event) for event in events]


def by_detector(
    samples: list[Sample], prominence: float, longest: int | None = None
) -> list[PeakEvent]:
    detector = Detector(prominence, longest_region=longest)
    return [*detector.feed(*columns(samples)), *detector.finish()]


def pieces(samples: list[Sample], cuts: list[int]) -> list[list[Sample]]:
    places = [0, *sorted(min(cut, len(samples)) for cut in cuts), len(samples)]
    return [samples[start:end] for start, end in itertools.pairwise(places)]


@given(samples=ADVERSARIAL, p=PROMINENCES)
def test_whole_tube_gives_the_events_of_the_detector(samples: list[Sample], p: float) -> None:
    found = find_peaks(*columns(samples), prominence=p)
    assert exactly(found) == exactly(by_detector(samples, p))


@given(samples=ADVERSARIAL, p=PROMINENCES, longest=LONGEST, cuts=CUTS)
def test_each_piece_gives_the_events_that_the_detector_gives_there(
    samples: list[Sample], p: float, longest: int | None, cuts: list[int]
) -> None:
    stream = PeakStream(p, longest_region=longest)
    detector = Detector(p, longest_region=longest)
    for piece in pieces(samples, cuts):
        assert exactly(stream.feed(*columns(piece))) == exactly(detector.feed(*columns(piece)))
    assert exactly(stream.finish()) == exactly(detector.finish())


@given(
    samples=ADVERSARIAL,
    p=PROMINENCES,
    cuts=CUTS,
    lost=st.lists(st.integers(0, 3), min_size=8, max_size=8),
)
def test_stated_gaps_are_those_of_the_detector(
    samples: list[Sample], p: float, cuts: list[int], lost: list[int]
) -> None:
    stream, detector = PeakStream(p), Detector(p)
    for piece, number in zip(pieces(samples, cuts), lost, strict=False):
        assert exactly(stream.feed(*columns(piece))) == exactly(detector.feed(*columns(piece)))
        assert exactly(stream.gap(number)) == exactly(detector.gap(number))


@pytest.mark.parametrize("kind", ["noise", "walk", "wide", "growing"])
@pytest.mark.parametrize("longest", [None, 300])
def test_long_tubes_in_blocks_give_the_events_of_the_detector(
    kind: str, longest: int | None
) -> None:
    rng = np.random.default_rng(len(kind))
    middle = rng.normal(size=6000)
    if kind == "walk":
        middle = middle.cumsum()
    radius = np.full(6000, 2.0 if kind == "wide" else 0.2)
    if kind == "growing":
        radius = np.linspace(0.0, 2.0, 6000)
    lo, hi = middle - radius, middle + radius
    for p in (0.1, 1.0, 5.0):
        stream = PeakStream(p, longest_region=longest)
        found = [e for k in range(0, 6000, 77) for e in stream.feed(lo[k : k + 77], hi[k : k + 77])]
        detector = Detector(p, longest_region=longest)
        expected = [*detector.feed(lo.tolist(), hi.tolist()), *detector.finish()]
        assert exactly([*found, *stream.finish()]) == exactly(expected)
        assert len(expected) > 0


@pytest.mark.parametrize(("length", "block"), [(60_000, 60_000), (6000, 1)])
@pytest.mark.parametrize("p", [1.0, 2.0, 3.0])
def test_short_tubes_full_of_ties_give_the_events_of_the_detector(
    length: int, block: int, p: float
) -> None:
    rng = np.random.default_rng(int(p))
    lo = rng.integers(-4, 5, length).astype(float)
    hi = lo + rng.choice([0.0, 0.0, 1.0, 2.0, 4.0], length)
    lo[rng.random(length) < 0.03] = nan
    stream, detector = PeakStream(p), Detector(p)
    for k in range(0, length, block):
        piece = lo[k : k + block], hi[k : k + block]
        expected = detector.feed(*(bound.tolist() for bound in piece))
        assert exactly(stream.feed(*piece)) == exactly(expected)
    assert exactly(stream.finish()) == exactly(detector.finish())


def test_kernel_takes_nothing_where_one_sample_could_decide_more_than_has_room() -> None:
    stream = PeakStream(1.0)
    sample = np.zeros(1)
    for room, taken in ((MOST_AT_ONCE - 1, 0), (MOST_AT_ONCE, 1)):
        assert search(sample, sample, 1.0, *stream._state, np.zeros(room, EVENT)) == (taken, 0)


def test_more_events_than_room_was_made_for_are_all_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eskin.peaks.stream._MOST_ROOM", 3)
    zigzag = np.arange(2001) % 2.0
    found = find_peaks(zigzag, zigzag, prominence=1.0)
    assert found.table["first"].tolist() == list(range(0, 2000, 2))
    assert found.total == (1000, 1000)


def test_missing_sample_is_a_gap() -> None:
    signal = [0.0, 5.0, nan, 0.0, 5.0, 0.0]
    assert [(e.first, e.last) for e in find_peaks(signal, signal, prominence=1.0)] == [(3, 5)]


def test_gap_reports_what_waits_before_it() -> None:
    lo, hi = [0.0, 0.0, 0.0, nan, 0.0], [2.0, 2.0, 2.0, nan, 2.0]
    (event,) = find_peaks(lo, hi, prominence=1.0)
    assert (event.first, event.last, event.count) == (0, 2, (0, 1))


def test_unbounded_sample_neither_is_a_certain_peak_nor_hides_one() -> None:
    lo, hi = [0.0, 4.0, -inf, 4.0, 0.0], [1.0, 5.0, inf, 5.0, 1.0]
    certain, possible = find_peaks(lo, hi, prominence=2.0)
    assert (certain.first, certain.last, certain.height) == (0, 4, (4.0, inf))
    assert certain.count == (1, 1)
    assert possible.count == (0, 1)


@pytest.mark.parametrize(
    ("lo", "hi"), [(2.0, 1.0), (inf, -inf), (inf, inf), (-inf, -inf), (0.0, -5e-324)]
)
def test_bounds_that_are_no_interval_are_refused(lo: float, hi: float) -> None:
    lows, highs = [0.0, 3.0, lo, 3.0], [0.0, 3.0, hi, 3.0]
    with pytest.raises(eskin.EskinError, match="sample 2 is no interval"):
        find_peaks(lows, highs, prominence=1.0)


def test_tube_and_interval_give_the_events_of_their_bounds() -> None:
    lo = np.array([0, 4, 0, 4, 0], dtype=np.float32)
    values = eskin.Interval(lo, lo + 1)
    tube = eskin.Tube(time=(0, 0), dt=1, values=values, unit="V", coverage=1.0)
    expected = find_peaks(lo, lo + 1, prominence=2.0)
    assert len(expected) == 2
    assert find_peaks(values, prominence=2.0) == expected
    assert find_peaks(tube, prominence=2.0) == expected
    assert PeakStream(2.0).feed(tube) == expected


def test_read_only_and_strided_bounds_compile_nothing_anew() -> None:
    signal = np.array([0.0, 9.0, 4.0, 9.0, 0.0, 9.0])
    expected = find_peaks(signal[::2].copy(), signal[::2].copy(), prominence=1.0)
    compiled: Any = search
    before = len(compiled.signatures)
    signal.flags.writeable = False
    assert find_peaks(signal[::2], signal[::2], prominence=1.0) == expected
    assert len(expected) == 1
    assert len(compiled.signatures) == before


def test_integers_that_no_float_holds_round_outward() -> None:
    huge = 2**53
    (event,) = find_peaks([0, huge + 1, 0], [0, huge + 1, 0], prominence=1.0)
    assert event.height == (float(huge), float(huge + 2))


@pytest.mark.parametrize(
    ("lows", "highs"), [([0.0], [0.0, 1.0]), ([[0.0]], [[0.0]]), (0.0, 0.0), ([0.0], None)]
)
def test_bounds_that_do_not_fit_each_other_are_refused(lows: object, highs: object) -> None:
    with pytest.raises(eskin.EskinError, match=r"highs|upper bounds"):
        find_peaks(lows, highs, prominence=1.0)  # type: ignore[call-overload]


def test_tube_with_other_highs_is_refused() -> None:
    with pytest.raises(eskin.EskinError, match="leave highs out"):
        find_peaks(eskin.Interval([0.0]), [1.0], prominence=1.0)


@pytest.mark.parametrize("prominence", [0.0, -1.0, inf, nan])
def test_prominence_that_is_not_positive_is_refused(prominence: float) -> None:
    with pytest.raises(ValueError, match="prominence must be positive"):
        PeakStream(prominence)


def test_peaks_are_a_sequence_of_events() -> None:
    peaks = find_peaks([0.0, 4.0, 0.0, 0.0, 0.0], [1.0, 5.0, 1.0, 3.0, 0.0], prominence=2.0)
    certain, possible = peaks
    assert isinstance(certain, PeakEvent)
    assert peaks[0] == certain
    assert peaks[-1] == possible
    assert list(peaks[1:]) == [possible]
    assert list(peaks.certain) == [certain]
    assert list(peaks.possible) == [possible]
    assert peaks.total == (1, 2)
    assert peaks != Peaks(peaks.table[:1])
    assert repr(peaks) == "Peaks(1 certain, 1 possible)"
