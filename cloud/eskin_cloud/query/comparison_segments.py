"""Segments of time with one verdict of a comparison."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.interval import Verdict
from eskin_cloud.query.occupancy import EntryCount

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from eskin_cloud.query.sample_validity import SampleValidity
    from eskin_cloud.rollup.aggregates import Integers
    from eskin_cloud.store.read.window import Window

_UNKNOWN: Final = -1


@dataclass(slots=True)
class ComparisonSegment:
    """A segment with one verdict.

    Attributes:
        start: UTC ns, included.
        end: UTC ns, excluded.
        answer: Whether one channel is above the other; ``None`` where unknown.
        slots: Most changes of the answer, plus one.
        shared: Samples of both that may be valid at the start and before.
        samples: Most samples of both that were compared.
        coverage: The least of these.
    """

    start: int
    end: int
    answer: Verdict | None
    slots: int = 1
    shared: int = 2
    samples: int = 0
    coverage: float = 1.0

    def grow(self, following: ComparisonSegment) -> None:
        """Append the next segment, which has the same verdict."""
        self.end = following.end
        self.slots += following.slots + 1 - following.shared
        self.samples += following.samples
        self.coverage = min(self.coverage, following.coverage)


def merge(stretches: Iterable[ComparisonSegment]) -> Iterator[ComparisonSegment]:
    """Merge neighbours with the same verdict."""
    current: ComparisonSegment | None = None
    for stretch in stretches:
        if current is None:
            current = stretch
        elif stretch.answer is current.answer and stretch.start == current.end:
            current.grow(stretch)
        else:
            yield current
            current = stretch
    if current is not None:
        yield current


@dataclass(frozen=True, slots=True)
class Comparison:
    """Whether one channel is above another, at each time.

    Attributes:
        sides: The one, and the other.
        edges: Times at which answers may change, from the window's start to its end, UTC ns.
        runs: Of each side, the first and the last entry that may be valid from each edge on.
        answers: Verdicts from each edge but the last on; -1 where a side is unknown.
    """

    sides: tuple[SampleValidity, SampleValidity]
    edges: Integers
    runs: tuple[tuple[NDArray[np.intp], NDArray[np.intp]], ...]
    answers: NDArray[np.int8]

    def stretches(self) -> Iterator[ComparisonSegment]:
        """All segments in order of time."""
        cut = np.flatnonzero(np.diff(self.answers, prepend=self.answers[:1] - 1))
        ends = np.append(cut[1:], self.answers.size)
        counts = np.zeros((3, cut.size), np.int64)
        for side, (first, last) in zip(self.sides, self.runs, strict=True):
            total = np.concatenate([[0], np.cumsum(side.pieces.n)])
            begun = np.searchsorted(side.begin, self.edges[cut], side="left") - first[cut]
            rows = last[ends - 1] + 1 - first[cut], begun, total[last[ends - 1] + 1]
            counts += np.maximum([rows[0], rows[1], rows[2] - total[first[cut]]], 0)
        starts, stops = self.edges[cut].tolist(), self.edges[ends].tolist()
        answers = self.answers[cut].tolist()
        coverage = min(float(side.pieces.coverage.min(initial=1.0)) for side in self.sides)
        for start, end, answer, *row in zip(starts, stops, answers, *counts.tolist(), strict=True):
            if answer == _UNKNOWN:
                yield ComparisonSegment(start, end, None)
            else:
                yield ComparisonSegment(
                    start, end, Verdict(answer), row[0] - 1, row[1], row[2], coverage
                )


def compare(one: SampleValidity, other: SampleValidity, window: Window) -> Comparison:
    """Compare two channels over a window that is not empty.

    One is certainly above the other where the hull of its possibly valid samples is above the
    other's hull, impossibly where it is not above anywhere, and unknown where either has a gap.
    """
    edges = np.concatenate([one.edges, other.edges])
    edges = edges[(edges > window.start) & (edges < window.end)]
    edges = np.unique(np.concatenate([[window.start], edges, [window.end]]))
    at = edges[:-1]
    runs = tuple(side.at(at) for side in (one, other))
    known = np.flatnonzero(one.is_known(at) & other.is_known(at))
    (low, high), (other_low, other_high) = (
        side.hulls(first[known], last[known])
        for side, (first, last) in zip((one, other), runs, strict=True)
    )
    answers = np.full(at.size, _UNKNOWN, np.int8)
    answers[known] = (low > other_high).astype(np.int8) + (high > other_low)
    return Comparison((one, other), edges, runs, answers)


@dataclass(frozen=True, slots=True)
class ComparisonTotals:
    """Totals of a comparison over a window.

    Attributes:
        time: Least and greatest time above, ns, while both are known.
        unknown: Time in which a channel is unknown, ns.
        entries: Least and greatest number of entries; each gap starts a new count.
        samples: Most samples of both that were compared.
        coverage: The least of these.
    """

    time: tuple[int, int]
    unknown: int
    entries: tuple[int, int]
    samples: int
    coverage: float


def total_comparison(stretches: Iterable[ComparisonSegment]) -> ComparisonTotals:
    """Total merged segments in order of time."""
    spent, unknown, samples, entries = [0, 0, 0], 0, 0, EntryCount()
    coverage = 1.0
    for stretch in stretches:
        if stretch.answer is None:
            unknown += stretch.end - stretch.start
            entries.part()
        else:
            spent[stretch.answer] += stretch.end - stretch.start
            entries.add(stretch.answer, stretch.slots)
        samples += stretch.samples
        coverage = min(coverage, stretch.coverage)
    entries.part()
    sure = spent[Verdict.CERTAIN]
    return ComparisonTotals(
        time=(sure, sure + spent[Verdict.POSSIBLE]),
        unknown=unknown,
        entries=(entries.least, entries.most),
        samples=samples,
        coverage=coverage,
    )
