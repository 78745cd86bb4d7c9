"""For how long and how often a channel is in a state: each told as an interval."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Final

from eskin_cloud.query.occupancy_bounds import OccupancyBounds
from eskin_cloud.query.predicate import Verdict
from eskin_cloud.query.segments import find_segments_of
from eskin_cloud.store.read.block_index import find_next

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sqlalchemy import Connection, RowMapping

    from eskin_cloud.query.predicate import Predicate
    from eskin_cloud.query.segments import Segment
    from eskin_cloud.store.read.window import Window

_NEVER: Final = 2**62
_OUTSIDE_FEW: Final = (0, _NEVER)
_OUTSIDE_MANY: Final = (0, -_NEVER)
"""No signal has entered yet."""


@dataclass(slots=True)
class Occupancy:
    """What is known of a state over a window.

    Samples are those whose moments, as they are told, lie in the window. By these moments a sample
    holds until the next, for its period at most and not beyond the window; the rest of the window
    is unknown.

    Attributes:
        time: ns in the state, at least and at most, while something is known: wherever the true
            moments lie within the samples' time errors, see `OccupancyBounds`.
        unknown: ns of which nothing is known.
        samples: How many samples are in the state.
        entries: How often the state began, among signals within the samples' intervals; what goes
            on behind a gap begins anew.
        n: Samples in the window.
        error: The greatest of their time errors, ns.
    """

    time: tuple[int, int]
    unknown: int
    samples: tuple[int, int]
    entries: tuple[int, int]
    n: int
    error: int


def measure_occupancy(
    connection: Connection, channel: RowMapping, window: Window, question: Predicate
) -> Occupancy:
    """Sum up a window; tiles and blocks that leave nothing open are not looked into."""
    runs = find_segments_of(connection, channel, window, question, over_gaps=False)
    return sum_up(runs, window, find_next(connection, channel, window))


def sum_up(runs: Iterable[Segment], window: Window, behind: int | None) -> Occupancy:
    """Sum up runs in order of time.

    Args:
        runs: All runs in the window.
        window: When.
        behind: The earliest true moment of the first sample behind the window.
    """
    samples, entries, occupancy_bounds = [0, 0, 0], Entries(), OccupancyBounds()
    last: Segment | None = None
    error = 0
    for run in chain(runs, [None]):
        if last is not None:
            end = window.end if run is None else run.start
            occupancy_bounds.add(last, end, behind if run is None else run.start - run.error)
            samples[last.answer] += last.n
            error = max(error, last.error)
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
    )


class Entries:
    """The least and the greatest number of entries into a state, run by run.

    For each of the two it keeps the best that ends outside of the state, and inside.

    Attributes:
        least: Over all parts that are closed.
        most: Likewise.
    """

    def __init__(self) -> None:
        self.least = self.most = 0
        self._few: tuple[int, int] = _OUTSIDE_FEW
        self._many: tuple[int, int] = _OUTSIDE_MANY

    def add(self, answer: Verdict, n: int) -> None:
        """Go on by a run of n signals with the same answer."""
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
        """Close a part: behind a gap nothing goes on."""
        self.least += min(self._few)
        self.most += max(self._many)
        self._few, self._many = _OUTSIDE_FEW, _OUTSIDE_MANY
