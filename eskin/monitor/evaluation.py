"""Evaluate a formula over recorded signals."""

from __future__ import annotations

from collections import defaultdict
from functools import cached_property
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin.monitor.atoms import GAP, KNOWN, candidates
from eskin.monitor.checks import Horizon, channel_horizons, check, merged_horizon
from eskin.monitor.formula import (
    Always,
    And,
    Atom,
    Comparison,
    Count,
    Eventually,
    Fall,
    Historically,
    Implies,
    Not,
    Once,
    Or,
    Rise,
    Since,
    Until,
)
from eskin.monitor.prediction import deviation
from eskin.monitor.runs import END, Runs, at_least, union
from eskin.monitor.signal import Signal, held_samples
from eskin.monitor.verdicts import Verdicts

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from eskin.monitor.atoms import Candidates
    from eskin.monitor.formula import Formula, Node
    from eskin.monitor.runs import Ticks
    from eskin.monitor.signal import HeldSamples
    from eskin.tube import Tube

Pair: TypeAlias = "tuple[Runs, Runs]"
"""Where a formula is true for certain, and where it may be true."""
_MORE_RUNS: Final = 6
"""Changes of ``until`` beside those of its operands: 2 (p + 2 q) of p and q runs, one each."""


def evaluate(formula: Formula, signals: Mapping[str, Signal | Tube]) -> Verdicts:
    """Evaluate a formula at all times.

    Args:
        formula: What to evaluate.
        signals: Each channel's samples; a tube is read as `Signal.from_tube` does. A deviation is
            made of its channel unless it is given by its name.

    Raises:
        MonitorError: The formula does not fit the signals: see `check`.
    """
    read = {
        name: each if isinstance(each, Signal) else Signal.from_tube(each)
        for name, each in signals.items()
    }
    check(formula, {name: each.unit for name, each in read.items()})
    for name, node in formula.deviations.items():
        if name not in read:
            read[name] = deviation(read[node.source], node.prediction)
    return Verdicts(Evaluation(formula, read))


class Evaluation:
    """A formula with what its atoms are made of.

    Attributes:
        formula: What is evaluated.
        signals: The channels that it reads.
        held: When each of their samples may hold.
    """

    def __init__(self, formula: Formula, signals: Mapping[str, Signal]) -> None:
        self.formula = formula
        self.signals = {name: signals[name] for name in sorted(formula.channels)}
        self.held: dict[str, HeldSamples] = {
            name: held_samples(each) for name, each in self.signals.items()
        }
        self._atoms: dict[Atom, Candidates] = {
            node: candidates(node, self.signals, self.held)
            for node in dict.fromkeys(formula.walk())
            if isinstance(node, Atom)
        }

    def verdicts(self, formula: Formula | None = None) -> Pair:
        """Where the formula, or a part of it, is certain, and where it is not impossible."""
        return self._walk(self.formula if formula is None else formula, _verdict)

    def explained_by(self, cause: int) -> Pair:
        """Where it fails not, and where it holds, for some choice that a cause leaves open.

        Args:
            cause: 0 for the widths of intervals, 1 for instants, too, 2 for gaps, too.
        """
        return self._walk(self.formula, _EXPLAINED[cause])

    def whatever_the_best(self) -> Pair:
        """Where it may fail not, and may hold, by what is before the frontier alone."""

        def pair(atom: Candidates) -> Pair:
            certain, possible = _verdict(atom)
            later = Runs.between(atom.frontier, END)
            return certain | later, possible & ~later

        return self._walk(self.formula, pair)

    def most_changes(self, first: int, last: int) -> int | None:
        """How often its truth may change from just before a run of ticks until just after it.

        Returns:
            ``None`` where samples are missing within the horizon: then there is no bound.
        """
        weights, found = self._weights
        for atom, weight in weights.items():
            past, future = self._horizons[atom]
            begin = -END if past is None else first - 2 * past
            # What is delayed changes later than its samples by its delay.
            delay = max((delay for _, delay in atom.variables), default=0)
            end = END if future is None else last + 1 + 2 * (future + delay)
            (earliest, latest), missing = self._changes[atom]
            if missing.overlaps(np.array([begin - 1]), np.array([end]))[0]:
                return None
            before = int(np.searchsorted(latest, begin, side="left"))
            until = int(np.searchsorted(earliest, end, side="right"))
            found += weight * max(until - before, 0)
        return found

    def in_question(self, name: str) -> tuple[Ticks, Ticks]:
        """Ticks whose verdicts each sample of a channel may change if more is known of it.

        Returns:
            The first and the last tick for each sample of the signal; ``first > last`` for one that
            holds nowhere, or only where comparisons are decided.
        """
        held, size = self.held[name], len(self.signals[name])
        first, last = np.full(size, END), np.full(size, -END)
        past, future = channel_horizons(self.formula)[name]
        opened = [
            self._open[atom].eventually(delay, delay)
            for atom in self._atoms
            for each, delay in atom.variables
            if each == name
        ]
        asked = np.flatnonzero(union(opened).overlaps(held.first, held.last))
        sample = held.index[asked]
        # Just before it begins, and just after it ends, ``rise`` and ``fall`` look at it.
        first[sample] = -END if future is None else held.first[asked] - 2 * future - 1
        last[sample] = END if past is None else held.last[asked] + 2 * past + 1
        return first, last

    @cached_property
    def _open(self) -> dict[Atom, Runs]:
        """Where each comparison is possible."""
        found = {}
        for atom, each in self._atoms.items():
            certain, possible = _verdict(each)
            found[atom] = possible & ~certain
        return found

    @cached_property
    def _horizons(self) -> dict[Atom, Horizon]:
        """How far the formula looks at each atom: as far as at the channels in it, at most."""
        of_channels = channel_horizons(self.formula)
        return {
            atom: merged_horizon([of_channels[name] for name in atom.channels] or [Horizon(0, 0)])
            for atom in self._atoms
        }

    @cached_property
    def _changes(self) -> dict[Atom, tuple[tuple[Ticks, Ticks], Runs]]:
        return {
            atom: (found.changes(atom, self.held), found.missing)
            for atom, found in self._atoms.items()
        }

    @cached_property
    def _weights(self) -> tuple[dict[Atom, int], int]:
        """How often the formula may change where each atom changes once, and besides.

        A window moves changes and adds none. ``rise`` and ``fall`` make two of each. φ until ψ is a
        union of one interval for each run of φ and each of ψ that overlap, and of those of ψ: of p
        and q runs, p + 2 q at most; and c changes make c / 2 + 1 runs at most.
        """
        weights: dict[Atom, int] = defaultdict(int)
        constant = 0
        waiting: list[tuple[Node, int]] = [(self.formula, 1)]
        while waiting:
            node, weight = waiting.pop()
            if isinstance(node, Atom):
                weights[node] += weight
            elif isinstance(node, Rise | Fall):
                waiting.append((node.operand, 2 * weight))
            elif isinstance(node, Until | Since):
                constant += _MORE_RUNS * weight
                waiting += [(node.left, weight), (node.right, 2 * weight)]
            else:
                waiting += [(part, weight) for part in node.parts]
        return weights, constant

    def differences(self) -> NDArray[np.float64]:
        """All values that a robustness can have, ascending."""
        found = [np.array([-np.inf, np.inf])]
        for atom in self._atoms.values():
            for side in (atom.difference.inf, atom.difference.sup):
                found += [side, -side]
        return np.unique(np.concatenate(found))

    def at_least(self, value: float, *, upper: bool) -> Runs:
        """Where the robustness reaches a value: for all choices of values, or for some."""

        def some(atom: Candidates) -> Pair:
            return (
                ~atom.where(atom.difference.inf <= -value),
                atom.where(atom.difference.sup >= value),
            )

        def every(atom: Candidates) -> Pair:
            return (
                atom.where(atom.difference.sup > -value),
                ~atom.where(atom.difference.inf < value),
            )

        return self._walk(self.formula, some if upper else every)[1]

    def _walk(self, formula: Formula, pair: Callable[[Candidates], Pair]) -> Pair:
        known: dict[int, Pair] = {}
        atoms: dict[Atom, Pair] = {}

        def visit(node: Formula) -> Pair:
            if isinstance(node, Atom):
                if node not in atoms:
                    atoms[node] = pair(self._atoms[node])
                return atoms[node]
            found = known.get(id(node))
            if found is None:
                parts = [visit(part) for part in node.parts]  # type: ignore[arg-type]  # formulas
                found = known[id(node)] = _combined(node, parts)
            return found

        return visit(formula)


def _verdict(atom: Candidates) -> Pair:
    return ~atom.where(~atom.certain), atom.where(atom.possible)


def _by_width(atom: Candidates) -> Pair:
    """Each candidate is a sample, and leaves it open by its width alone."""
    known = _decided(atom)
    return atom.where(~known | atom.certain), ~atom.where(~(known & atom.possible))


def _by_instant(atom: Candidates) -> Pair:
    """Some candidate is a sample that leaves it open, or several that differ."""
    known = _decided(atom)
    return ~atom.where(known & ~atom.certain), atom.where(known & atom.possible)


def _by_gap(atom: Candidates) -> Pair:
    known = _decided(atom) | (atom.kind == GAP)
    return ~atom.where(known & ~atom.certain), atom.where(known & atom.possible)


def _decided(atom: Candidates) -> NDArray[np.bool_]:
    """Candidates that need no unknown value: of samples, or decided by any value."""
    return np.asarray((atom.kind == KNOWN) | atom.certain | ~atom.possible)


_EXPLAINED = (_by_width, _by_instant, _by_gap)


def _combined(node: Formula, parts: list[Pair]) -> Pair:  # noqa: C901, PLR0911, PLR0912 - a line a kind
    """An operator, on what is certain and on what is possible; a negation exchanges them."""
    lower, upper = [pair[0] for pair in parts], [pair[1] for pair in parts]
    if isinstance(node, Not):
        return ~upper[0], ~lower[0]
    if isinstance(node, And):
        return at_least(lower, len(parts)), at_least(upper, len(parts))
    if isinstance(node, Or):
        return at_least(lower, 1), at_least(upper, 1)
    if isinstance(node, Implies):
        return ~upper[0] | lower[1], ~lower[0] | upper[1]
    if isinstance(node, Always):
        return lower[0].always(*node.bounds), upper[0].always(*node.bounds)
    if isinstance(node, Eventually):
        return lower[0].eventually(*node.bounds), upper[0].eventually(*node.bounds)
    if isinstance(node, Historically):
        return lower[0].historically(*node.bounds), upper[0].historically(*node.bounds)
    if isinstance(node, Once):
        return lower[0].once(*node.bounds), upper[0].once(*node.bounds)
    if isinstance(node, Until):
        return lower[0].until(lower[1], *node.bounds), upper[0].until(upper[1], *node.bounds)
    if isinstance(node, Since):
        return lower[0].since(lower[1], *node.bounds), upper[0].since(upper[1], *node.bounds)
    if isinstance(node, Rise):
        return lower[0] & (~upper[0]).just_before(), upper[0] & (~lower[0]).just_before()
    if isinstance(node, Fall):
        return ~upper[0] & lower[0].just_before(), ~lower[0] & upper[0].just_before()
    assert isinstance(node, Count)  # noqa: S101 - there is no other
    least = node.number + (node.comparison in {Comparison.GREATER, Comparison.LESS_EQUAL})
    if node.comparison.upward:
        return at_least(lower, least), at_least(upper, least)
    return ~at_least(upper, least), ~at_least(lower, least)
