"""Verdicts over time: what a monitor answers."""

from __future__ import annotations

from enum import Flag, auto
from functools import cached_property
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.errors import MonitorError
from eskin.interval import Interval, Verdict
from eskin.monitor.checks import channel_horizons
from eskin.monitor.formula import Always, Eventually, Historically, Once
from eskin.monitor.runs import END, Runs
from eskin.monitor.signal import MAX_INSTANT
from eskin.union_bound import union_coverage

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike, NDArray

    from eskin.monitor.evaluation import Evaluation
    from eskin.monitor.formula import Formula
    from eskin.monitor.runs import Ticks


class Because(Flag):
    """Why a verdict is only possible."""

    WIDTH = auto()
    """Samples' intervals reach across a threshold."""
    INSTANT = auto()
    """It is not known which sample holds."""
    GAP = auto()
    """Samples are missing."""
    PENDING = auto()
    """Samples are still to come."""


_VERDICTS: Final = (Verdict.IMPOSSIBLE, Verdict.POSSIBLE, Verdict.CERTAIN)
_CAUSES = (Because.WIDTH, Because.INSTANT, Because.GAP, Because.PENDING)


class Piece(NamedTuple):
    """A stretch of time with one verdict.

    Attributes:
        start: Its first instant in ns, or the one after which it begins; ``None`` if there is none.
        includes_start: Whether the first instant belongs to it.
        end: Its last instant, or the one before which it ends; ``None`` if there is none.
        includes_end: Whether the last instant belongs to it.
        verdict: What holds there.
    """

    start: int | None
    includes_start: bool
    end: int | None
    includes_end: bool
    verdict: Verdict


def piece(first: int, last: int, code: int) -> Piece:
    """The piece from a tick to another."""
    return Piece(
        None if first == -END else first // 2,
        first % 2 == 0,
        None if last == END else (last + 1) // 2,
        last % 2 == 0,
        _VERDICTS[code],
    )


class Verdicts:
    """A verdict at each instant: piecewise constant, from the infinite past to the infinite future.

    Attributes:
        ticks: Where pieces begin, ascending: 2t is the instant t in ns, 2t + 1 just after it. The
            first is the least int64 but one.
        codes: `Verdict` of each piece, int8.
    """

    def __init__(self, evaluation: Evaluation) -> None:
        self._evaluation = evaluation
        self._certain, self._possible = evaluation.verdicts()
        edges = [np.array([-END])]
        for runs in (self._certain, self._possible):
            edges += [runs.first, runs.last[runs.last != END] + 1]
        ticks: Ticks = np.unique(np.concatenate(edges))
        codes = self.codes_at_ticks(ticks)
        kept = np.append(True, codes[1:] != codes[:-1])
        self.ticks, self.codes = ticks[kept], codes[kept]

    @property
    def formula(self) -> Formula:
        """What is answered."""
        return self._evaluation.formula

    def at(self, t: int) -> Verdict:
        """The verdict at an instant in ns."""
        return Verdict(int(self.codes_at(t)))

    def codes_at(self, times: ArrayLike) -> NDArray[np.int8]:
        """`Verdict` at each of some instants in ns."""
        return self.codes_at_ticks(_ticks(times))

    def final(self, t: int) -> bool:
        """Whether no later sample can change the verdict at an instant in ns."""
        return bool(self.final_at(t))

    def final_at(self, times: ArrayLike) -> NDArray[np.bool_]:
        """Whether no later sample can change the verdict at each of some instants in ns."""
        return self._final.contains(_ticks(times))

    def because(self, t: int) -> Because:
        """Why the verdict at an instant is possible; nothing where it is not.

        The weakest cause by which it could be true, and the weakest by which it could be false;
        they ascend from width over instant and gap to pending, each with those before it.
        """
        if self.at(t) is not Verdict.POSSIBLE:
            return Because(0)
        return self.holds_by(t) | self.fails_by(t)

    def holds_by(self, t: int) -> Because:
        """The weakest cause by which a possible verdict could be true, such as for an alarm."""
        return self._cause(self._holding, t)

    def fails_by(self, t: int) -> Because:
        """The weakest cause by which a possible verdict could be false."""
        return self._cause(self._failing, t)

    def held_by_samples(self) -> Runs:
        """Ticks at which it could hold by the samples that exist: by their width or instants."""
        return self._certain | self._by_samples[1]

    def failed_by_samples(self) -> Runs:
        """Ticks at which it could fail by the samples that exist."""
        return ~(self._possible & self._by_samples[0])

    def causes(self, first: Ticks, last: Ticks) -> list[Because]:
        """All of what `because` says of the instants of some runs of ticks."""
        found = [Because(0)] * first.size
        for cause, runs in self._causes:
            for k in np.flatnonzero(runs.overlaps(first, last)).tolist():
                found[k] |= cause
        return found

    def in_question(self, name: str) -> tuple[Ticks, Ticks]:
        """The first and the last tick whose verdict each sample of a channel may change.

        If more were known of it, that is: its value, its instant, or the samples for which it
        stands. ``first > last`` for one that changes nothing.
        """
        return self._evaluation.in_question(name)

    def most_changes(self, first: int, last: int) -> int | None:
        """How often its truth may change from just before a run of ticks until just after it.

        ``None`` where samples are missing within the horizon.
        """
        return self._evaluation.most_changes(first, last)

    def coverage(self, t: int) -> float:
        """Probability with which the verdict at an instant is right, at least.

        It is 1 - Σ(1 - c) over the distinct samples that may hold within the formula's horizon.
        """
        signals, missed = self._evaluation.signals, []
        for name, seen in self.samples_seen(t).items():
            missed += [signals[name].coverage] * seen.size
        if all(coverage == 1.0 for coverage in missed):
            return 1.0
        return union_coverage(*missed)

    def samples_seen(self, t: int) -> dict[str, NDArray[np.intp]]:
        """The samples of each channel that may hold within the horizon of an instant in ns."""
        found = {}
        for name, (past, future) in channel_horizons(self.formula).items():
            held = self._evaluation.held[name]
            first = -END if past is None else 2 * (t - past) - 1
            last = END if future is None else 2 * (t + future)
            begin = int(np.searchsorted(held.last, first, side="left"))
            end = int(np.searchsorted(held.first, last, side="right"))
            found[name] = held.index[begin:end]
        return found

    def robustness(self, t: int) -> Interval:
        """How far the formula is from changing its truth at an instant, for all choices of values.

        The smallest difference between two sides of a comparison that decides, negative where the
        formula is false; in the units of the comparisons, so use one.
        """
        values = self._evaluation.differences()
        tick = _ticks(t)

        def greatest(*, upper: bool) -> float:
            low, high = 0, values.size - 1  # it reaches -inf always
            while low < high:
                middle = (low + high + 1) // 2
                reached = self._evaluation.at_least(float(values[middle]), upper=upper)
                low, high = (middle, high) if reached.contains(tick) else (low, middle - 1)
            return float(values[low])

        lower, upper = greatest(upper=False), greatest(upper=True)
        largest = np.finfo(np.float64).max
        return Interval(min(lower, largest), max(upper, -largest))

    def witness(self, t: int) -> int | None:
        """An instant in ns that proves the verdict at t.

        Of a certain ``eventually`` or ``once`` an instant at which the operand is certain, of an
        impossible ``always`` or ``historically`` one at which it is impossible; the first one.
        Where the operand is decided only between two instants, the earlier one of them.

        Returns:
            ``None`` where no single instant proves it.
        """
        formula, verdict = self.formula, self.at(t)
        if isinstance(formula, Eventually | Once) and verdict is Verdict.CERTAIN:
            proof = self._evaluation.verdicts(formula.operand)[0]
        elif isinstance(formula, Always | Historically) and verdict is Verdict.IMPOSSIBLE:
            proof = ~self._evaluation.verdicts(formula.operand)[1]
        else:
            return None
        a, b = formula.bounds
        far = END if b is None else 2 * b
        first, last = 2 * t + 2 * a, END if b is None else 2 * t + far
        if isinstance(formula, Historically | Once):
            first, last = (-END if b is None else 2 * t - far), 2 * t - 2 * a
        seen = proof & Runs.between(first, last)
        whole = seen.first + seen.first % 2  # the first instant of each run, if it has one
        instants = whole[whole <= seen.last]
        found = int(instants[0]) if instants.size else int(seen.first[0])
        return int(max(found, -2 * MAX_INSTANT)) // 2

    def pieces(self, first: int = -END, last: int = END) -> Iterator[Piece]:
        """The pieces in order, or what of them lies between two ticks."""
        begin = int(np.searchsorted(self.ticks, first, side="right")) - 1
        end = int(np.searchsorted(self.ticks, last, side="right"))
        starts = np.maximum(self.ticks[begin:end], first)
        ends = np.minimum(np.append(self.ticks[1:] - 1, END)[begin:end], last)
        for start, stop, code in zip(
            starts.tolist(), ends.tolist(), self.codes[begin:end].tolist(), strict=True
        ):
            yield piece(start, stop, code)

    def __iter__(self) -> Iterator[Piece]:
        return self.pieces()

    def final_until(self, tick: int) -> int | None:
        """The last tick up to which all is final from a given one on; ``None`` if it is not."""
        at = int(np.searchsorted(self._final.first, tick, side="right")) - 1
        if at < 0 or self._final.last[at] < tick:
            return None
        return int(self._final.last[at])

    def __len__(self) -> int:
        return int(self.ticks.size)

    def codes_at_ticks(self, ticks: Ticks) -> NDArray[np.int8]:
        """`Verdict` at each of some ticks."""
        return np.add(self._certain.contains(ticks), self._possible.contains(ticks), dtype=np.int8)

    @cached_property
    def _by_samples(self) -> tuple[Runs, Runs]:
        """Where it fails not, and where it holds, by samples that exist."""
        return self._evaluation.explained_by(1)

    @cached_property
    def _explained(self) -> list[tuple[Runs, Runs]]:
        explained = self._evaluation.explained_by
        return [explained(0), self._by_samples, explained(2)]

    @cached_property
    def _causes(self) -> list[tuple[Because, Runs]]:
        """Where each cause is the weakest by which a possible verdict could hold, or fail."""
        found = []
        for runs in (self._holding, self._failing):
            rest = self._possible & ~self._certain
            for cause, each in zip(_CAUSES, [*runs, Runs.between(-END, END)], strict=True):
                found.append((cause, rest & each))
                rest = rest & ~each
        return found

    @cached_property
    def _holding(self) -> list[Runs]:
        return [upper for _, upper in self._explained]

    @cached_property
    def _failing(self) -> list[Runs]:
        return [~lower for lower, _ in self._explained]

    @cached_property
    def _final(self) -> Runs:
        """Decided, as any value counts where samples may come, or open by what is there already."""
        kept, held = self._evaluation.whatever_the_best()
        return self._certain | ~self._possible | (held & ~kept)

    def _cause(self, runs: list[Runs], t: int) -> Because:
        if self.at(t) is not Verdict.POSSIBLE:
            return Because(0)
        tick = _ticks(t)
        return next(
            (cause for cause, each in zip(_CAUSES, runs, strict=False) if each.contains(tick)),
            Because.PENDING,
        )


def _ticks(times: ArrayLike) -> Ticks:
    given = np.asarray(times)
    if given.dtype.kind not in "iu" or (given.size and np.max(np.abs(given)) > MAX_INSTANT):
        raise MonitorError(f"times must be whole ns since 1970, not {times!r}", value=times)
    return 2 * given.astype(np.int64)
