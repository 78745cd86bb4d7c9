"""When samples are valid, given their time errors.

A sample's true time lies within its time error, and samples were taken in the order of their stated
times. A sample is valid from its time until the next one's; before a gap, for its period.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.rollup.aggregates import longest_step

if TYPE_CHECKING:
    from typing import Any, Self

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_cloud.rollup.aggregates import Aggregates, Integers


@dataclass(frozen=True, slots=True)
class SampleValidity:
    """When each entry may be valid, and when one certainly is.

    Attributes:
        pieces: Entries in order of time, none with a gap inside, each of one time error.
        begin: The earliest time at which each may be valid, UTC ns; sorted.
        end: The time from which on each is certainly not valid; sorted.
        known: Starts and ends of the ranges in which a sample is certainly valid.
    """

    pieces: Aggregates
    begin: Integers
    end: Integers
    known: tuple[Integers, Integers]

    @classmethod
    def of(cls, pieces: Aggregates) -> Self:
        """Compute the validity of entries."""
        first, last, dt, error = pieces.first, pieces.last, pieces.dt, pieces.error
        if len(pieces) == 0:
            return cls(pieces, first, first, (first, first))
        earliest = np.maximum.accumulate(before(last, error))
        begin = np.maximum(before(first, error), np.append([-MOST_MOMENT], earliest[:-1]))
        latest = np.minimum.accumulate(after(first, error)[::-1])[::-1]
        following = np.append(latest[1:], [MOST_MOMENT])
        broken = np.append(first[1:] - last[:-1] > longest_step(dt[:-1]), [True])
        held = after(np.minimum(after(last, error), following), dt)
        end = np.where(broken, np.minimum(held, following), following)
        started = np.concatenate([[True], broken[:-1]])
        known = latest[started], after(earliest, dt)[broken]
        good = known[0] < known[1]
        return cls(pieces, begin, end, (np.sort(known[0][good]), np.sort(known[1][good])))

    @property
    def edges(self) -> Integers:
        """All times at which the validity changes."""
        return np.concatenate([self.begin, self.end, *self.known])

    def is_known(self, moments: Integers) -> NDArray[np.bool_]:
        """Whether a sample is certainly valid, at each time."""
        begun, over = (np.searchsorted(each, moments, side="right") for each in self.known)
        return np.asarray(begun > over)

    def at(self, moments: Integers) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The first and the last possibly valid entry at each time; last < first if none."""
        first = np.searchsorted(self.end, moments, side="right")
        return first, np.searchsorted(self.begin, moments, side="right") - 1

    def hulls(self, first: NDArray[np.intp], last: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """The hull of each run of entries from first to last."""
        lo, hi = self.pieces.lo, self.pieces.hi
        return run_extremes(np.minimum, lo, first, last), run_extremes(np.maximum, hi, first, last)


def after(moments: Integers, spans: Integers) -> Integers:
    """Times plus spans, limited to 64 bits."""
    return np.where(moments > MOST_MOMENT - spans, MOST_MOMENT, moments + spans)


def before(moments: Integers, spans: Integers) -> Integers:
    """Times minus spans, limited to 64 bits."""
    return np.where(moments < spans - MOST_MOMENT, -MOST_MOMENT, moments - spans)


def run_extremes(
    extreme: Any, values: Floats, first: NDArray[np.intp], last: NDArray[np.intp]
) -> Floats:
    """The extreme of each run of values, by a sparse table.

    Args:
        extreme: ``np.minimum`` or ``np.maximum``.
        values: The values.
        first: Start of each run.
        last: End of each run, included.
    """
    found = np.empty(first.size)
    _, bits = np.frexp(last - first + 1)
    table = values
    for level in range(1, int(bits.max(initial=0)) + 1):
        here, width = bits == level, 1 << (level - 1)
        found[here] = extreme(table[first[here]], table[last[here] + 1 - width])
        table = extreme(table[:-width], table[width:])
    return found
