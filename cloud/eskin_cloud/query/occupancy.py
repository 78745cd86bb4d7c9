"""Total time and number of entries of a state, as intervals."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Final

from eskin.interval import Verdict
from eskin_cloud.query.segments import find_segments_of
from eskin_cloud.store.read.patch_columns import find_next

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sqlalchemy import Connection

    from eskin_cloud.query.predicate import Predicate
    from eskin_cloud.query.segments import Segment
    from eskin_cloud.store.read.lookup import Channel
    from eskin_cloud.store.read.window import Window

_NEVER: Final = 2**62
_OUTSIDE_FEW: Final = (0, _NEVER)
_OUTSIDE_MANY: Final = (0, -_NEVER)
"""Before the first sample, the signal is outside."""


@dataclass(slots=True)
class Occupancy:
    """Totals of a state over a window.

    Samples are those whose stated times lie in the window. By these times a sample is valid until
    the next, for its period at most and not beyond the window; the rest of the window is unknown.

    Attributes:
        time: Least and greatest time in the state, ns, for any true times within the samples'
            time errors, see `OccupancyBounds`.
        unknown: Time without a valid sample, ns.
        samples: Least and greatest number of samples in the state.
        entries: Least and greatest number of entries into the state, among signals within the
            samples' intervals; each gap starts a new count.
        n: Number of samples in the window.
        error: The greatest of their time errors, ns.
        coverage: The least of theirs.
    """

    time: tuple[int, int]
    unknown: int
    samples: tuple[int, int]
    entries: tuple[int, int]
    n: int
    error: int
    coverage: float


def measure_occupancy(
    connection: Connection, channel: Channel, window: Window, question: Predicate
) -> Occupancy:
    """Total a window; samples are read only where tiles are undecided."""
    runs = find_segments_of(connection, channel, window, question)
    return total_occupancy(runs, window, find_next(connection, channel, window.end))


def total_occupancy(runs: Iterable[Segment], window: Window, behind: int | None) -> Occupancy:
    """Total segments in order of time.

    Args:
        runs: All segments of the window.
        window: The window.
        behind: The earliest true time of the first sample after the window.
    """
    samples, entries, occupancy_bounds = [0, 0, 0], EntryCount(), OccupancyBounds()
    last: Segment | None = None
    error, coverage = 0, 1.0
    for run in chain(runs, [None]):
        if last is not None:
            end = window.end if run is None else run.start
            occupancy_bounds.add(last, end, behind if run is None else run.start - run.error)
            samples[last.answer] += last.n
            error = max(error, last.error)
            coverage = min(coverage, last.coverage)
            entries.add(last.answer, last.n)
            if run is not None and not last.reaches(run):
                entries.part()
                occupancy_bounds.part()
        last = run
    entries.part()
    occupancy_bounds.part()
    sure, likely = Verdict.CERTAIN, Verdict.POSSIBLE
    return Occupancy(
        time=occupancy_bounds.time,
        unknown=max(0, window.span - occupancy_bounds.known),
        samples=(samples[sure], samples[sure] + samples[likely]),
        entries=(entries.least, entries.most),
        n=sum(samples),
        error=error,
        coverage=coverage,
    )


class EntryCount:
    """Counts the least and the greatest number of entries into a state.

    For each of the two it keeps the optimum of signals that end outside and inside of the state.

    Attributes:
        least: Over all closed parts.
        most: Likewise.
    """

    def __init__(self) -> None:
        self.least = self.most = 0
        self._few: tuple[int, int] = _OUTSIDE_FEW
        self._many: tuple[int, int] = _OUTSIDE_MANY

    def add(self, answer: Verdict, n: int) -> None:
        """Append n samples with the same verdict."""
        (few_out, few_in), (many_out, many_in) = self._few, self._many
        if answer is Verdict.CERTAIN:
            self._few = _NEVER, min(few_in, few_out + 1)
            self._many = -_NEVER, max(many_in, many_out + 1)
        elif answer is Verdict.IMPOSSIBLE:
            self._few = min(few_out, few_in), _NEVER
            self._many = max(many_out, many_in), -_NEVER
        else:
            self._few = min(few_out, few_in), min(few_in, few_out + 1)
            outside = max(many_out + n // 2, many_in + (n - 1) // 2)
            inside = max(many_out + (n + 1) // 2, many_in + n // 2)
            self._many = outside, inside

    def part(self) -> None:
        """Close a part at a gap."""
        self.least += min(self._few)
        self.most += max(self._many)
        self._few, self._many = _OUTSIDE_FEW, _OUTSIDE_MANY


class OccupancyBounds:
    """The least time of each verdict, for any true times within the samples' time errors.

    Sample k is stated at ``t_k`` and was taken at some ``s_k`` in ``[t_k - e_k, t_k + e_k]``;
    samples were taken in the order of ``t``. It is valid from ``s_k`` until ``s_(k+1)``; before a
    gap, for at most ``dt_k``. Let samples i to j have one verdict and no gap, and let their stated
    validity end at ``h``: the least of ``t_(j+1)``, ``t_j + dt_j`` and the window's end. In truth
    one of them is valid from ``s_i`` until ``s_(j+1)`` if no gap follows, else until the lesser of
    ``s_j + dt_j`` and ``s_(j+1)``. These times are

    - at the latest ``t_i + e_i``,
    - at the earliest ``min(t_j + dt_j - e_j, t_(j+1) - e_(j+1))``.

    Between both, and before ``h``, the verdict holds for certain. That is the stated range without
    ``e_i`` at its start, and without what follows the second time at its end. A certain range is in
    the state for at least so long, an impossible range is outside for at least so long, and the
    rest of the known time is possible. Exact clocks lose nothing. Samples stated outside of the
    window count only by their order.

    Attributes:
        known: Time with a valid sample by the stated times, ns.
    """

    def __init__(self) -> None:
        self.known = 0
        self._sure = [0, 0, 0]
        self._answer: Verdict | None = None
        self._current = self._lost = 0

    @property
    def time(self) -> tuple[int, int]:
        """Least and greatest known time in the state, ns."""
        return self._sure[Verdict.CERTAIN], self.known - self._sure[Verdict.IMPOSSIBLE]

    def add(self, run: Segment, end: int, following: int | None) -> None:
        """Append a segment, which has no gap inside unless it is impossible.

        Args:
            run: The segment.
            end: Its latest end by the stated times.
            following: The earliest true time of the next sample; ``None`` if there is none.
        """
        if run.answer is not self._answer:
            self.part()
            self._answer, self._current = run.answer, -run.error
        known_until = run.end + max(0, min(end - run.end, run.dt))
        earliest = run.end + run.dt - run.error
        earliest = earliest if following is None else min(earliest, following)
        self._lost = max(0, known_until - earliest)
        self._current += run.held + known_until - run.end
        self.known += run.held + known_until - run.end

    def part(self) -> None:
        """Close a range at a gap."""
        if self._answer is not None:
            self._sure[self._answer] += max(0, self._current - self._lost)
        self._answer = None
