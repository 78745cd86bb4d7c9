"""Boolean signals in dense time, as sorted runs of ticks.

All breakpoints of a Boolean signal are whole ns, as samples' instants, periods and windows are. So
it is constant at each instant t, and on each open interval (t, t + 1) between two. The *tick* 2t is
the instant t, and the tick 2t + 1 that open interval; a signal is a set of ticks, written as runs
``[first, last]``. The operators below are exact on these sets: docs/monitors.md has the lemmas.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Ticks = NDArray[np.int64]

END: Final = 2**63 - 1
"""The last tick; ``-END`` is the first. A run that reaches there has no end."""


@dataclass(frozen=True)
class Runs:
    """A set of ticks.

    Attributes:
        first: First tick of each run, ascending, int64.
        last: Last tick of each run; the next run begins two ticks later at least.
    """

    first: Ticks
    last: Ticks

    @classmethod
    def of(cls, first: Ticks, last: Ticks) -> Self:
        """The union of runs in any order; those with ``first > last`` are empty."""
        full = first <= last
        if not full.all():
            first, last = first[full], last[full]
        if first.size < 2:
            return cls(first, last)
        if np.any(first[1:] < first[:-1]):
            order = np.argsort(first, kind="stable")
            first, last = first[order], last[order]
        reach = np.maximum.accumulate(last)
        begins = np.concatenate(([True], first[1:] - 1 > reach[:-1]))
        ends = np.concatenate((begins[1:], [True]))
        return cls(first[begins], reach[ends])

    @classmethod
    def between(cls, first: int, last: int) -> Self:
        """One run, or none where ``first > last``."""
        return cls.of(np.array([first], dtype=np.int64), np.array([last], dtype=np.int64))

    def __invert__(self) -> Runs:
        first, last = self.first, self.last
        if first.size == 0:
            return Runs.between(-END, END)
        starts = np.concatenate(([-END], np.where(last == END, END, last + 1)))
        ends = np.concatenate((first - 1, [END]))
        if last[-1] == END:
            starts, ends = starts[:-1], ends[:-1]
        return Runs.of(starts, ends)

    def __or__(self, other: Runs) -> Runs:
        return at_least((self, other), 1)

    def __and__(self, other: Runs) -> Runs:
        return at_least((self, other), 2)

    def contains(self, ticks: Ticks) -> NDArray[np.bool_]:
        """Whether each tick is in the set."""
        if self.first.size == 0:
            return np.zeros(ticks.shape, dtype=bool)
        at = np.searchsorted(self.first, ticks, side="right") - 1
        return np.asarray((at >= 0) & (self.last[at] >= ticks))

    def overlaps(self, first: Ticks, last: Ticks) -> NDArray[np.bool_]:
        """Whether any tick of each other run is in the set."""
        begin = np.searchsorted(self.last, first, side="left")
        return np.asarray(np.searchsorted(self.first, last, side="right") > begin)

    def eventually(self, a: int, b: int | None) -> Runs:
        """Ticks from whose window [a, b] ns later a tick of the set is seen."""
        first = np.full_like(self.first, -END) if b is None else _shifted(self.first, -2 * b)
        return Runs.of(first, _shifted(self.last, -2 * a))

    def once(self, a: int, b: int | None) -> Runs:
        """Ticks from whose window [a, b] ns earlier a tick of the set is seen."""
        last = np.full_like(self.last, END) if b is None else _shifted(self.last, 2 * b)
        return Runs.of(_shifted(self.first, 2 * a), last)

    def always(self, a: int, b: int | None) -> Runs:
        """Ticks whose window [a, b] ns later lies in the set."""
        return ~(~self).eventually(a, b)

    def historically(self, a: int, b: int | None) -> Runs:
        """Ticks whose window [a, b] ns earlier lies in the set."""
        return ~(~self).once(a, b)

    def until(self, other: Runs, a: int, b: int | None) -> Runs:
        """This set until another: a tick u of the other in the window, and this set before u.

        An instant u needs this set on the ticks before it; an open interval u on itself, too, as
        some of it lies before each instant in it.
        """
        first, last = self.first, self.last
        reach = np.where((last % 2 == 1) & (last < END), last + 1, last)
        begin = np.searchsorted(other.last, first, side="left")
        many = np.maximum(np.searchsorted(other.first, reach, side="right") - begin, 0)
        ours = np.repeat(np.arange(first.size), many)
        theirs = np.arange(ours.size) - np.repeat(np.cumsum(many) - many, many) + begin[ours]
        low = np.maximum(other.first[theirs], first[ours])
        high = np.minimum(other.last[theirs], reach[ours])
        earliest = np.full_like(low, -END) if b is None else _shifted(low, -2 * b)
        starts = np.maximum(earliest, first[ours])
        ends = np.minimum(_shifted(high, -2 * a), last[ours])
        if a == 0:  # at once: nothing lies before
            starts, ends = np.append(starts, other.first), np.append(ends, other.last)
        return Runs.of(starts, ends)

    def since(self, other: Runs, a: int, b: int | None) -> Runs:
        """This set since another: `until` with time reversed, which keeps instants instants."""
        return self.mirrored().until(other.mirrored(), a, b).mirrored()

    def just_before(self) -> Runs:
        """Ticks just before whose instants the set holds: on some (t - ε, t)."""
        last = np.where(self.last % 2 == 1, self.last, self.last - 1)
        first = self.first | 1
        return Runs.of(first, np.where(first > last, first - 1, _shifted(last, 1)))

    def mirrored(self) -> Runs:
        """The set with time reversed about 1970."""
        return Runs(-self.last[::-1], -self.first[::-1])


def union(parts: Sequence[Runs]) -> Runs:
    """Ticks that are in some set."""
    return Runs.of(
        np.concatenate([part.first for part in parts]),
        np.concatenate([part.last for part in parts]),
    )


def at_least(parts: Sequence[Runs], number: int) -> Runs:
    """Ticks that are in so many of the sets."""
    if number <= 0:
        return Runs.between(-END, END)
    if number == 1:
        return union(parts)
    if number > len(parts):
        return Runs.between(0, -1)
    first = np.concatenate([part.first for part in parts])
    last = np.concatenate([part.last for part in parts])
    ticks = np.concatenate((first, last))
    steps = np.concatenate((np.ones(first.size, np.int64), np.full(last.size, -1)))
    order = np.argsort(ticks, kind="stable")  # of one tick: what begins there comes first
    counts = np.cumsum(steps[order])
    before = counts - steps[order]
    begins = (before == number - 1) & (counts == number)
    ends = (before == number) & (counts == number - 1)
    return Runs.of(ticks[order][begins], ticks[order][ends])


def _shifted(ticks: Ticks, by: int) -> Ticks:
    """Ticks moved; those without end stay where they are."""
    return np.where(np.abs(ticks) == END, ticks, ticks + by)
