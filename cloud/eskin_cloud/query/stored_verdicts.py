"""A formula over stored channels: by hulls where they decide it, else by samples.

The hull of consecutive samples holds all of them. So a run of samples is read as one sample, whose
value lies in the hull and is held until the next run begins; a run with a gap in it has any value.
Verdicts by runs are those of the samples, or possible. Of what stays possible, the runs that leave
a comparison open are replaced by shorter ones, all over the window at once, down to single samples;
but not where no sample that exists could decide it.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.errors import MonitorError, QueryError
from eskin.interval import Verdict
from eskin.monitor import Because, check, evaluate
from eskin.monitor.checks import channel_horizons
from eskin.monitor.prediction import deviation
from eskin.monitor.runs import END, Runs, union
from eskin.monitor.signal import MAX_INSTANT
from eskin.union_bound import union_coverage
from eskin_cloud.query.channel_runs import ChannelRuns
from eskin_cloud.store.read.window import Window

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from numpy.typing import NDArray

    from eskin.monitor import Formula, Verdicts
    from eskin.monitor.runs import Ticks
    from eskin_cloud.query.channel_runs import ChannelSource
    from eskin_cloud.rollup.aggregates import Aggregates

YEAR: Final = 31_557_600_000_000_000
"""A Julian year of 365.25 d, in ns."""
POINTS: Final = 1024
"""Runs of a channel that are evaluated at first, at most."""
SAMPLES: Final = 2**11
"""Samples of a run that are read as they are."""
_AT_ONCE: Final = 8
"""How many times as many are, of the whole window or of many runs."""
_CROWDED: Final = 2**17
"""Runs of a channel from which on a stretch that is open only in part is given in parts."""
MOST_SAMPLES: Final = 2**20
"""Runs of a channel from which on what is open stays possible: as long as the formula's horizon."""
MOST_READS: Final = 2000
"""Stretches that one request reads, of 2^14 samples at most."""


class SampledChannel(NamedTuple):
    """How a channel of a formula is sampled.

    Attributes:
        step: The least time between two samples, ns.
        error: The greatest time error, ns.
        coverage: The least coverage of a sample.
        reach: How long the stretch of time is that the formula looks at, ns.
    """

    step: int
    error: int
    coverage: float
    reach: int

    @property
    def most_samples(self) -> int:
        """Samples that may hold within the horizon of one instant, at most.

        The first instants of all but one of them lie within the horizon and the errors of time
        around it; that one holds since before it.
        """
        return (self.reach + 2 * self.error) // self.step + 2


def false_a_year(channels: Collection[SampledChannel]) -> float:
    """Expected number of false verdicts a year, at most, with one at each sample of each channel.

    A verdict is right where all samples are that may hold within its horizon: so it is false with
    a probability of Σ(1 - c) over them at most. Expected numbers add up, whatever depends on what.
    Rounded up; 0 where every coverage is 1.
    """
    beyond = sum((1 - Fraction(each.coverage)) * each.most_samples for each in channels)
    verdicts = sum(Fraction(YEAR, each.step) for each in channels)
    exact = verdicts * min(beyond, Fraction(1))
    nearest = float(exact)
    return math.nextafter(nearest, math.inf) if Fraction(nearest) < exact else nearest


class StoredPiece(NamedTuple):
    """A stretch with one verdict, in ticks: 2t is the instant t in ns, 2t + 1 just after it.

    Attributes:
        first: The first tick.
        last: The last one.
        verdict: What holds there.
        missing: Whether it is possible, and could hold by samples alone that do not exist.
        because: All that makes it possible; nothing where it is not.
        coverage: Probability with which the verdict is right in its middle, at least.
        changes: How often the truth may change in it and at its ends; ``None`` without bound.
    """

    first: int
    last: int
    verdict: Verdict
    missing: bool
    because: Because
    coverage: float
    changes: int | None

    def joined(self, other: StoredPiece) -> StoredPiece:
        """This stretch and the one after it, which has the same verdict."""
        unbounded = self.changes is None or other.changes is None
        return self._replace(
            last=other.last,
            because=self.because | other.because,
            coverage=min(self.coverage, other.coverage),
            changes=None if unbounded else (self.changes or 0) + (other.changes or 0),
        )


class StoredVerdicts:
    """Evaluates a formula over stored channels.

    Args:
        formula: All its windows must be bounded.
        sources: Where each channel that it measures is read, by its name in the formula.
        points: Runs of a channel that are evaluated at first, at most.
        samples: Samples of a run that are read as they are.
        most_reads: Stretches that are read, at most.

    Attributes:
        reads: How many stretches were read so far.
        coverage: Probability with which all verdicts of the window are right, at least: the union
            bound over its samples, and over those within the horizon.
        false_a_year: How many verdicts a year are false, as an expected number at most, if one is
            taken at each sample of each channel, as often as those of the window come.
        reach: How many ns before and after an instant count for its verdict.

    Raises:
        QueryError: The formula does not fit the channels.
    """

    def __init__(
        self,
        formula: Formula,
        sources: Mapping[str, ChannelSource],
        *,
        points: int = POINTS,
        samples: int = SAMPLES,
        most_reads: int = MOST_READS,
    ) -> None:
        units = {name: source.channel["unit"] for name, source in sources.items()}
        try:
            past, future = check(formula, units, bounded=True)
        except MonitorError as error:
            raise QueryError("formula", str(error)) from error
        self._formula, self._sources = formula, sources
        self._points, self._samples, self._most_reads = points, samples, most_reads
        self._measured = {name: name for name in formula.channels}
        self._measured |= {name: node.source for name, node in formula.deviations.items()}
        self.reach = past or 0, future or 0
        self.reads = 0
        self.coverage = 1.0
        self.false_a_year = 0.0

    def pieces(self, window: Window) -> Iterator[StoredPiece]:
        """Verdicts of a window in order of time, until too many stretches were read.

        Raises:
            QueryError: The window, or instants in it, are too far from 1970.
        """
        if window.start < -MAX_INSTANT or window.end > MAX_INSTANT:
            raise QueryError("start, end", "formulas are evaluated within 109 years of 1970")
        waiting: StoredPiece | None = None
        for piece in self._solve(window):
            if waiting is None:
                waiting = piece
            elif (piece.verdict, piece.missing) == (waiting.verdict, waiting.missing):
                waiting = waiting.joined(piece)
            else:
                yield waiting
                waiting = piece
        if waiting is not None:
            yield waiting

    def _solve(self, window: Window) -> Iterator[StoredPiece]:
        past, future = self.reach
        around = Window(
            max(window.start - past, -MAX_INSTANT), min(window.end + future, MAX_INSTANT)
        )
        at, end, most = 2 * window.start, 2 * window.end - 1, _AT_ONCE * self._samples
        runs = {
            name: ChannelRuns.first(source, around, self._points, most)
            for name, source in self._sources.items()
        }
        self.reads += 1
        self._state_errors(runs)
        while at <= end and self.reads <= self._most_reads:
            found = self._evaluated(runs, around)
            asked = {name: self._asked(found, name) for name in runs}
            unsettled = union(
                [Runs.between(0, -1), *map(_of_several, runs.values(), asked.values())]
            )
            size = max((len(each.pieces) for each in runs.values()), default=0)
            stretches = _Stretches.of(found, (at, end), unsettled, in_parts=size > _CROWDED)
            if size > MOST_SAMPLES and stretches.is_open.any():
                until = int(stretches.first[stretches.is_open][0]) + 2 * (past + future + 1)
                unsettled &= Runs.between(until, END)
                stretches = _Stretches.of(found, (at, end), unsettled, in_parts=True)
            opened = np.flatnonzero(stretches.is_open)
            settled = int(opened[0]) if opened.size else stretches.first.size
            yield from self._explained(found, runs, stretches.pieces(settled))
            if not opened.size:
                return
            at = int(stretches.first[settled])
            ours = Runs.of(stretches.first[opened], stretches.last[opened])
            room = min(max(most, size), MOST_SAMPLES)
            for name, each in runs.items():
                finer, reads = each.finer(ours.overlaps(*asked[name]), self._samples, room)
                runs[name] = finer.since(at // 2 - past - 1)
                self.reads += reads

    def _evaluated(self, runs: Mapping[str, ChannelRuns], around: Window) -> Verdicts:
        try:
            signals = {name: each.signal(around) for name, each in runs.items()}
            for name, node in self._formula.deviations.items():
                known = signals[node.source]
                span = np.where(runs[node.source].are_several, known.period, 0)
                signals[name] = deviation(known, node.prediction, span)
            return evaluate(self._formula, signals)
        except MonitorError as error:
            raise QueryError("formula", str(error)) from error

    def _asked(self, found: Verdicts, channel: str) -> tuple[Ticks, Ticks]:
        """The first and the last tick whose verdict each run of a channel may change."""
        ends = [found.in_question(name) for name, of in self._measured.items() if of == channel]
        first, last = zip(*ends, strict=True)
        return np.minimum.reduce(first), np.maximum.reduce(last)

    def _explained(
        self, found: Verdicts, runs: Mapping[str, ChannelRuns], pieces: list[StoredPiece]
    ) -> Iterator[StoredPiece]:
        """Stretches with all that is stated of them."""
        possible = [piece for piece in pieces if piece.verdict is Verdict.POSSIBLE]
        ends = np.array([(piece.first, piece.last) for piece in possible], np.int64).reshape(-1, 2)
        causes = iter(found.causes(ends[:, 0], ends[:, 1]) if possible else [])
        for piece in pieces:
            coverage = self._coverage(found, runs, (piece.first + piece.last) // 4)
            if piece.verdict is Verdict.POSSIBLE:
                changes = found.most_changes(piece.first, piece.last)
                yield piece._replace(because=next(causes), coverage=coverage, changes=changes)
            else:
                yield piece._replace(coverage=coverage)

    def _coverage(self, found: Verdicts, runs: Mapping[str, ChannelRuns], instant: int) -> float:
        """That of an instant; a run stands for many samples, so they are counted there."""
        if self.coverage == 1.0:
            return 1.0
        past, future = self.reach
        several = {name: runs[of].are_several for name, of in self._measured.items()}
        if any(np.any(several[name][seen]) for name, seen in found.samples_seen(instant).items()):
            around = Window(instant - past, instant + future + 1)
            if any(around.span > MOST_SAMPLES * each.dt for each in runs.values()):
                return self.coverage
            whole = {name: ChannelRuns.around(each.source, around) for name, each in runs.items()}
            found = self._evaluated(whole, around)
        return found.coverage(instant)

    def _state_errors(self, runs: Mapping[str, ChannelRuns]) -> None:
        read = {name: each.pieces for name, each in runs.items()}
        self.coverage = union_coverage(
            *(
                union_coverage(pieces.coverage.min(initial=1.0), n=int(pieces.n.sum()))
                for pieces in read.values()
            )
        )
        if self.coverage < 1.0:
            self.false_a_year = self._false_a_year(read)

    def _false_a_year(self, read: Mapping[str, Aggregates]) -> float:
        found = []
        for name, (past, future) in channel_horizons(self._formula).items():
            measured = self._formula.deviations.get(name)
            pieces = read[name if measured is None else measured.source]
            if len(pieces) == 0:
                continue
            within = (pieces.last - pieces.first) // np.maximum(pieces.n - 1, 1)
            step = np.where(pieces.n > 1, np.minimum(pieces.dt, within), pieces.dt)
            found.append(
                SampledChannel(
                    step=max(int(step.min()), 1),
                    error=int(pieces.error.max()),
                    coverage=float(pieces.coverage.min()),
                    reach=(past or 0) + (future or 0),
                )
            )
        return false_a_year(found)


class _Stretches(NamedTuple):
    """Stretches of a window in order of time, an array entry each, in ticks.

    Attributes:
        first: The first tick.
        last: The last one.
        code: Its `Verdict`.
        missing: Whether it is possible, and could hold by samples alone that do not exist.
        is_open: Whether shorter runs of samples may decide it.
    """

    first: Ticks
    last: Ticks
    code: NDArray[np.int8]
    missing: NDArray[np.bool_]
    is_open: NDArray[np.bool_]

    @classmethod
    def of(
        cls, found: Verdicts, ends: tuple[int, int], unsettled: Runs, *, in_parts: bool
    ) -> _Stretches:
        """Those between two ticks.

        Args:
            found: The verdicts.
            ends: The first and the last tick.
            unsettled: Where shorter runs of samples may change a verdict.
            in_parts: Whether a stretch ends where it is no longer unsettled; else it is open if any
                of it is.
        """
        begin, end = ends
        held, failed = found.held_by_samples(), found.failed_by_samples()
        edges = [np.array([begin, end + 1]), found.ticks]
        for runs in (held, failed, *([unsettled] * in_parts)):
            edges += [runs.first, runs.last[runs.last < end] + 1]
        ticks = np.unique(np.concatenate(edges))
        first = ticks[(ticks >= begin) & (ticks <= end)]
        codes = found.codes_at_ticks(first)
        possible = codes == Verdict.POSSIBLE
        is_held, is_failed = held.contains(first), failed.contains(first)
        missing, is_open = possible & ~is_held, possible & (is_held | is_failed)
        if in_parts:
            is_open &= unsettled.contains(first)
        cut = np.flatnonzero(np.diff(codes + 4 * missing + 8 * is_open, prepend=-1))
        first = first[cut]
        last = np.append(first[1:] - 1, end)
        is_open = is_open[cut] & unsettled.overlaps(first, last)
        return cls(first, last, codes[cut], missing[cut], is_open)

    def pieces(self, n: int) -> list[StoredPiece]:
        """The first of them, without what is stated of possible ones."""
        columns = (each[:n].tolist() for each in (self.first, self.last, self.code, self.missing))
        return [
            StoredPiece(
                first, last, Verdict(code), missing, because=Because(0), coverage=1.0, changes=0
            )
            for first, last, code, missing in zip(*columns, strict=True)
        ]


def _of_several(runs: ChannelRuns, asked: tuple[Ticks, Ticks]) -> Runs:
    """Ticks whose verdicts may change if the runs of several samples become shorter."""
    return Runs.of(asked[0][runs.are_several], asked[1][runs.are_several])
