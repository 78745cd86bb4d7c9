"""Comparisons over time: which samples may hold at each tick, and what they make of an atom."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.interval import Interval
from eskin.monitor.checks import as_interval, comparison_of, linear_of, sides
from eskin.monitor.formula import Comparison
from eskin.monitor.runs import END, Runs
from eskin.monitor.shared import SharingColumns
from eskin.monitor.signal import HeldSamples

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eskin.monitor.checks import Linear
    from eskin.monitor.formula import Atom
    from eskin.monitor.runs import Ticks
    from eskin.monitor.signal import Signal

    _IndexRuns = tuple[Ticks, Ticks]
    _Cells = tuple[Ticks, Ticks, list[NDArray[np.int64]], NDArray[np.int8]]

KNOWN, GAP, PENDING = range(3)
"""What a value is that may hold: that of a sample, any in a gap, any of a later sample."""

MOST_CANDIDATES: Final = 2**18
"""Combinations of samples of several channels that may hold at once, over all time; where there are
more, the samples of each channel that may hold at once count as one, which has any of their values.
"""
_SHARING: Final = 2
"""Samples that may share errors with each other, at least."""


@dataclass(frozen=True)
class Candidates:
    """All that an atom may be made of, each in a run of ticks.

    Wherever several runs overlap, any of them may be the true one; at each tick there is one.

    Attributes:
        first, last: The run of ticks of each candidate.
        kind: KNOWN, or GAP or PENDING where one of the values is any.
        certain: True for all values of the candidate.
        possible: True for some.
        difference: What is positive where the comparison holds, for robustness.
        frontier: No later sample can change what is before this tick.
    """

    first: Ticks
    last: Ticks
    kind: NDArray[np.int8]
    certain: NDArray[np.bool_]
    possible: NDArray[np.bool_]
    difference: Interval
    frontier: int

    def where(self, chosen: NDArray[np.bool_]) -> Runs:
        """Ticks at which one of the chosen candidates may hold."""
        return Runs.of(self.first[chosen], self.last[chosen])

    @property
    def missing(self) -> Runs:
        """Ticks at which samples may be missing that could decide it."""
        return self.where((self.kind != KNOWN) & ~self.certain & self.possible)

    def changes(self, atom: Atom, held: Mapping[str, HeldSamples]) -> tuple[Ticks, Ticks]:
        """The first and the last tick at which its truth may change, for each instant that may do.

        Of one channel, an instant between two samples that decide it alike changes nothing.
        """
        variables = sorted(atom.variables)
        if len(variables) > 1:
            parts = [_instants(_delayed(held[name], delay)) for name, delay in variables]
            earliest, latest = (np.concatenate(each) for each in zip(*parts, strict=True))
            return np.sort(earliest), np.sort(latest)
        known = np.flatnonzero(self.kind == KNOWN)
        before, after = known[:-1], known[1:]
        certain, possible = self.certain, self.possible
        alike = (certain[before] & certain[after]) | ~(possible[before] | possible[after])
        earliest, latest = _instants(self, known)
        return earliest[~alike], latest[~alike]


def candidates(
    atom: Atom, signals: Mapping[str, Signal], held: Mapping[str, HeldSamples]
) -> Candidates:
    """Evaluate an atom for all samples, or pairs of samples, that may hold at once.

    Where those are too many, hulls of all samples of a channel that may hold at once.
    """
    variables = sorted(atom.variables)
    units = {name: signals[name].unit for name, _ in variables}
    delayed = {each: _delayed(held[each[0]], each[1]) for each in variables}
    if len(variables) == 1:
        first, last, choices, kind = _of_one(delayed[variables[0]])
        runs: list[_IndexRuns | None] = [None]
    else:
        first, last, choices, kind, runs = _of_several([delayed[each] for each in variables])
    plain, shares = {}, {}
    for variable, choice, joined in zip(variables, choices, runs, strict=True):
        signal, index = signals[variable[0]], held[variable[0]].index
        lo, hi = signal.lo[index], signal.hi[index]
        if joined is not None:
            lo, hi = _extremes(np.minimum, lo, *joined), _extremes(np.maximum, hi, *joined)
        # After the samples stands what is not known; so the sample -1 has any value.
        lo, hi = np.append(lo, -np.inf), np.append(hi, np.inf)
        plain[variable] = Interval(lo[choice], hi[choice])
        if signal.shared is not None and joined is None:
            epochs = np.append(np.broadcast_to(signal.shared.epoch, signal.lo.shape)[index], 0)
            shares[variable] = signal.shared, epochs[choice]
    columns = SharingColumns(plain, shares)
    left, right = (side.value for side in comparison_of(atom, columns, units))
    certain, possible = judge(left, atom.comparison, right)
    above, below = (left, right) if atom.comparison.upward else (right, left)
    shape = first.shape
    made = as_interval(above) - as_interval(below)
    difference = Interval(np.broadcast_to(made.inf, shape), np.broadcast_to(made.sup, shape))
    certain, possible = np.broadcast_to(certain, shape), np.broadcast_to(possible, shape)
    linear = None if len(shares) < _SHARING else _difference(atom, units)
    if linear is not None:
        difference = columns.narrow(linear, difference)
        strict = atom.comparison.strict
        certain = certain | (difference.inf > 0.0 if strict else difference.inf >= 0.0)
        possible = possible & (difference.sup > 0.0 if strict else difference.sup >= 0.0)
    frontier = min((each.frontier for each in delayed.values()), default=END)
    return Candidates(first, last, kind, certain, possible, difference, frontier)


def _difference(atom: Atom, units: Mapping[str, str]) -> Linear | None:
    """What is positive where a comparison holds, as a sum of channels, in the unit compared in."""
    left, right = (linear_of(side, units) for side in (atom.left, atom.right))
    if left is None or right is None:
        return None
    minus = right.times(Fraction(-1), right.unit)
    # A constant is converted rather than a channel.
    found = left.plus(minus) if left.terms else minus.plus(left)
    return found if atom.comparison.upward else found.times(Fraction(-1), found.unit)


def _instants(
    held: HeldSamples | Candidates, chosen: NDArray[np.intp] | slice = slice(None)
) -> tuple[Ticks, Ticks]:
    """The ticks at which each sample but the first may begin to hold."""
    first, last = held.first[chosen], held.last[chosen]
    return first[1:], np.maximum(last[:-1] + 1, first[1:])


def _delayed(held: HeldSamples, delay: int) -> HeldSamples:
    """When each sample may be the one that held so many ns ago."""
    if delay == 0:
        return held
    return HeldSamples(
        held.first + 2 * delay,
        held.last + 2 * delay,
        held.index,
        held.gaps.once(delay, delay),
        held.pending.once(delay, delay),
        held.frontier if abs(held.frontier) == END else held.frontier + 2 * delay,
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


def _of_several(held: list[HeldSamples]) -> tuple[*_Cells, list[_IndexRuns | None]]:
    """Cut time where a candidate of a channel begins or ends; in each cell, all combinations.

    Returns:
        Cells, and of each channel ``None``; or the run of samples that its choices stand for, which
        are cells then.
    """
    edges = [np.array([-END])]
    for each in held:
        for part in (each, each.gaps, each.pending):
            edges += [part.first, part.last[part.last != END] + 1]
    first = np.unique(np.concatenate(edges))
    last = np.append(first[1:] - 1, END)
    begins = [np.searchsorted(each.last, first, side="left") for each in held]
    counts = [
        np.maximum(np.searchsorted(each.first, first, side="right") - begin, 0)
        for each, begin in zip(held, begins, strict=True)
    ]
    unknown = [(each.gaps.contains(first), each.pending.contains(first)) for each in held]
    many = [known + gap + pending for known, (gap, pending) in zip(counts, unknown, strict=True)]
    are_joined = float(np.prod(np.array(many, np.float64), axis=0).sum()) > MOST_CANDIDATES
    runs: list[_IndexRuns | None] = [None] * len(held)
    if are_joined:
        runs = [
            (begin, np.maximum(begin + known - 1, begin))
            for begin, known in zip(begins, counts, strict=True)
        ]
        begins = [np.arange(first.size)] * len(held)
        counts = [np.minimum(known, 1) for known in counts]
    cell = np.arange(first.size)
    choices: list[NDArray[np.int64]] = []
    kind = np.zeros(first.size, np.int8)
    for begin, known, (gap, pending) in zip(begins, counts, unknown, strict=True):
        repeats = (known + gap + pending)[cell]
        which = np.repeat(np.arange(cell.size), repeats)
        place = np.arange(which.size) - np.repeat(np.cumsum(repeats) - repeats, repeats)
        cell, kind = cell[which], kind[which]
        choices = [choice[which] for choice in choices]
        of_sample = place < known[cell]
        choices.append(np.where(of_sample, begin[cell] + place, -1))
        rest = np.where((place == known[cell]) & gap[cell], GAP, PENDING)
        kind = np.maximum(kind, np.where(of_sample, KNOWN, rest)).astype(np.int8)
    return first[cell], last[cell], choices, kind, runs


def _extremes(
    extreme: Any, values: NDArray[np.float64], first: Ticks, last: Ticks
) -> NDArray[np.float64]:
    """The least or greatest of each run of values, by a sparse table.

    Args:
        extreme: ``np.minimum`` or ``np.maximum``.
        values: The values.
        first: Start of each run; where that is behind the values, the result is of no use.
        last: End of each run, included.
    """
    first, last = (np.minimum(each, max(values.size - 1, 0)) for each in (first, last))
    found = np.zeros(first.size)
    if values.size == 0:
        return found
    _, bits = np.frexp(last - first + 1)
    table = values
    for level in range(1, int(bits.max(initial=0)) + 1):
        here, width = bits == level, 1 << (level - 1)
        found[here] = extreme(table[first[here]], table[last[here] + 1 - width])
        table = extreme(table[:-width], table[width:])
    return found


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
