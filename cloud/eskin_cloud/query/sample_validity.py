"""What a channel may be at each moment: the hull of all samples that may hold then.

A sample's moment lies within its time error, and the samples of a channel were taken in the order
of their times. A sample holds from its moment until the next one's; before a gap, for its period.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.store.read.block_index import longest_step

if TYPE_CHECKING:
    from typing import Any, Self

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_cloud.rollup.aggregates import Aggregates, Integers


@dataclass(frozen=True, slots=True)
class SampleValidity:
    """When each of some pieces may hold, and when one of them surely does.

    Attributes:
        pieces: In order of time, none with a gap inside, each of one time error.
        begin: The earliest moment at which each may hold, UTC ns; never falls.
        end: The moment from which on each surely holds no more; never falls.
        known: Begins and ends of the stretches in which some sample surely holds.
    """

    pieces: Aggregates
    begin: Integers
    end: Integers
    known: tuple[Integers, Integers]

    @classmethod
    def of(cls, pieces: Aggregates) -> Self:
        """Work it out."""
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
        """All moments at which something changes."""
        return np.concatenate([self.begin, self.end, *self.known])

    def is_known(self, moments: Integers) -> NDArray[np.bool_]:
        """Whether a sample surely holds, at each moment."""
        begun, over = (np.searchsorted(each, moments, side="right") for each in self.known)
        return np.asarray(begun > over)

    def at(self, moments: Integers) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The first and the last piece that may hold, at each moment; reversed if there is none."""
        first = np.searchsorted(self.end, moments, side="right")
        return first, np.searchsorted(self.begin, moments, side="right") - 1

    def hulls(self, first: NDArray[np.intp], last: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """The hull of each run of pieces from a first to a last."""
        lo, hi = self.pieces.lo, self.pieces.hi
        return run_extremes(np.minimum, lo, first, last), run_extremes(np.maximum, hi, first, last)


def after(moments: Integers, spans: Integers) -> Integers:
    """Moments and so much, up to the end of time."""
    return np.where(moments > MOST_MOMENT - spans, MOST_MOMENT, moments + spans)


def before(moments: Integers, spans: Integers) -> Integers:
    """Moments less so much, down to the beginning of time."""
    return np.where(moments < spans - MOST_MOMENT, -MOST_MOMENT, moments - spans)


def run_extremes(
    extreme: Any, values: Floats, first: NDArray[np.intp], last: NDArray[np.intp]
) -> Floats:
    """The extreme of each run of values, from a first to a last, as runs of powers of two.

    Args:
        extreme: ``np.minimum`` or ``np.maximum``.
        values: One a place.
        first: Where each run begins.
        last: Where it ends, not before.
    """
    found = np.empty(first.size)
    _, bits = np.frexp(last - first + 1)
    table = values
    for level in range(1, int(bits.max(initial=0)) + 1):
        here, width = bits == level, 1 << (level - 1)
        found[here] = extreme(table[first[here]], table[last[here] + 1 - width])
        table = extreme(table[:-width], table[width:])
    return found
