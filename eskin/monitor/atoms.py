"""Comparisons over time: which samples may hold at each tick, and what they make of an atom."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import MonitorError
from eskin.interval import Interval
from eskin.monitor.checks import as_interval, comparison_of, sides
from eskin.monitor.formula import Comparison
from eskin.monitor.runs import END, Runs

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eskin.monitor.formula import Atom
    from eskin.monitor.runs import Ticks
    from eskin.monitor.signal import HeldSamples, Signal

    _Cells = tuple[Ticks, Ticks, list[NDArray[np.int64]], NDArray[np.int8]]

KNOWN, GAP, PENDING = range(3)
"""What a value is that may hold: that of a sample, any in a gap, any of a later sample."""

_MOST_CANDIDATES: Final = 2**26
"""Combinations of samples of several channels that may hold at once, over all time."""


@dataclass(frozen=True)
class Candidates:
    """All that an atom may be made of, each in a run of ticks.

    Wherever several runs overlap, any of them may be the true one; at each tick there is one.

    Attributes:
        first, last: The run of ticks of each candidate.
        kind: KNOWN, or GAP or PENDING where one of the values is any.
        certain: True for all values of the candidate.
        possible: True for some.
        sides: The greater side of the comparison and the less one, where it holds.
        frontier: No later sample can change what is before this tick.
    """

    first: Ticks
    last: Ticks
    kind: NDArray[np.int8]
    certain: NDArray[np.bool_]
    possible: NDArray[np.bool_]
    sides: tuple[Interval, Interval]
    frontier: int

    @cached_property
    def difference(self) -> Interval:
        """What is positive where the comparison holds, for robustness."""
        above, below = self.sides
        made = above - below
        shape = self.first.shape
        return Interval(np.broadcast_to(made.inf, shape), np.broadcast_to(made.sup, shape))

    def where(self, chosen: NDArray[np.bool_]) -> Runs:
        """Ticks at which one of the chosen candidates may hold."""
        return Runs.of(self.first[chosen], self.last[chosen])


def candidates(
    atom: Atom, signals: Mapping[str, Signal], held: Mapping[str, HeldSamples]
) -> Candidates:
    """Evaluate an atom for all samples, or pairs of samples, that may hold at once.

    Raises:
        MonitorError: Moments are so uncertain that there are too many.
    """
    names = sorted(atom.channels)
    units = {name: signals[name].unit for name in names}
    if len(names) == 1:
        first, last, choices, kind = _of_one(held[names[0]])
    else:
        first, last, choices, kind = _of_several([held[name] for name in names])
    columns = {}
    for name, choice in zip(names, choices, strict=True):
        signal, index = signals[name], held[name].index
        # After the samples stands what is not known; so the sample -1 has any value.
        lo = np.append(signal.lo[index], -np.inf)
        hi = np.append(signal.hi[index], np.inf)
        columns[name] = Interval(lo[choice], hi[choice])
    left, right = (side.value for side in comparison_of(atom, columns, units))
    certain, possible = judge(left, atom.comparison, right)
    shape = first.shape
    x, y = as_interval(left), as_interval(right)
    return Candidates(
        first,
        last,
        kind,
        np.broadcast_to(certain, shape),
        np.broadcast_to(possible, shape),
        (x, y) if atom.comparison.upward else (y, x),
        min((held[name].frontier for name in names), default=END),
    )


def _of_one(held: HeldSamples) -> _Cells:
    parts = (held, held.gaps, held.pending)
    sizes = [part.first.size for part in parts]
    choice = np.append(np.arange(sizes[0]), np.full(sizes[1] + sizes[2], -1))
    return (
        np.concatenate([part.first for part in parts]),
        np.concatenate([part.last for part in parts]),
        [choice],
        np.repeat(np.array([KNOWN, GAP, PENDING], np.int8), sizes),
    )


def _of_several(held: list[HeldSamples]) -> _Cells:
    """Cut time where a candidate of a channel begins or ends; in each cell, all combinations."""
    edges = [np.array([-END])]
    for each in held:
        for part in (each, each.gaps, each.pending):
            edges += [part.first, part.last[part.last != END] + 1]
    first = np.unique(np.concatenate(edges))
    last = np.append(first[1:] - 1, END)
    cell = np.arange(first.size)
    choices: list[NDArray[np.int64]] = []
    kind = np.zeros(first.size, np.int8)
    for each in held:
        begin = np.searchsorted(each.last, first, side="left")
        known = np.maximum(np.searchsorted(each.first, first, side="right") - begin, 0)
        gap, pending = each.gaps.contains(first), each.pending.contains(first)
        many = (known + gap + pending)[cell]
        if int(many.sum()) > _MOST_CANDIDATES:
            raise MonitorError(
                f"more than {_MOST_CANDIDATES} combinations of samples may hold at once; their "
                "moments are too uncertain: evaluate shorter stretches of time",
                value=int(many.sum()),
            )
        which = np.repeat(np.arange(cell.size), many)
        place = np.arange(which.size) - np.repeat(np.cumsum(many) - many, many)
        cell, kind = cell[which], kind[which]
        choices = [choice[which] for choice in choices]
        of_sample = place < known[cell]
        choices.append(np.where(of_sample, begin[cell] + place, -1))
        unknown = np.where((place == known[cell]) & gap[cell], GAP, PENDING)
        kind = np.maximum(kind, np.where(of_sample, KNOWN, unknown)).astype(np.int8)
    return first[cell], last[cell], choices, kind


def judge(  # noqa: PLR0911 - a line for each kind of sides
    left: Fraction | Interval | None, comparison: Comparison, right: Fraction | Interval | None
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether a comparison is true for all values, and for some.

    A constant is compared exactly, although no float may hold it: x > c of a float x is x > the
    greatest float that is not above c.
    """
    if isinstance(left, Fraction) and isinstance(right, Fraction):
        true = np.array(
            {
                Comparison.GREATER: left > right,
                Comparison.GREATER_EQUAL: left >= right,
                Comparison.LESS: left < right,
                Comparison.LESS_EQUAL: left <= right,
            }[comparison]
        )
        return true, true
    if not comparison.upward:
        turned = Comparison.GREATER if comparison.strict else Comparison.GREATER_EQUAL
        return judge(right, turned, left)
    if isinstance(right, Fraction):
        x = as_interval(left)
        below, above = sides(right)
        if comparison.strict:
            return x.inf > below, x.sup > below
        return x.inf >= above, x.sup >= above
    if isinstance(left, Fraction):
        y = as_interval(right)
        below, above = sides(left)
        if comparison.strict:
            return above > y.sup, above > y.inf
        return below >= y.sup, below >= y.inf
    x, y = as_interval(left), as_interval(right)
    if comparison.strict:
        return x.inf > y.sup, x.sup > y.inf
    return x.inf >= y.sup, x.sup >= y.inf
