"""A formula over stored channels: by hulls where they decide it, else by samples.

The hull of consecutive samples holds all of them. So a run of samples is read as one sample, whose
value lies in the hull and is held until the next run begins; a run with a gap in it has any value.
Verdicts by runs are those of the samples, or possible. Stretches that stay possible are evaluated
again by shorter runs, down to single samples, but where no sample that exists could decide them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.errors import MonitorError, QueryError
from eskin.interval import Verdict
from eskin.monitor import Because, Signal, check, evaluate
from eskin.monitor.checks import channel_horizons
from eskin.monitor.formula import MAX_BOUND
from eskin.monitor.prediction import deviation
from eskin.monitor.signal import MAX_MOMENT
from eskin.union_bound import union_coverage
from eskin_cloud.query.false_verdicts import SampledChannel, false_a_year
from eskin_cloud.query.neighbourhood import read_around
from eskin_cloud.rollup.aggregates import longest_step
from eskin_cloud.rollup.hulls import read_hulls
from eskin_cloud.store.read.window import Window

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from eskin.monitor import Formula, Verdicts
    from eskin_cloud.query.neighbourhood import ChannelSource
    from eskin_cloud.rollup.aggregates import Aggregates, Integers

POINTS: Final = 1024
"""Runs of a channel that are evaluated at once."""
SAMPLES: Final = 2**14
"""Samples of a stretch that are read as they are."""
_FIRST_SAMPLES: Final = 4
"""How many times as many are, of the whole window."""
_FINER: Final = 4
"""How many times as long as a stretch that stays possible the one around it must be."""
MOST_SAMPLES: Final = 2**20
"""Samples that are read of a stretch that is as short as the formula's horizon."""
MOST_READS: Final = 2000
"""Stretches that one request evaluates."""


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
        points: Runs of a channel that are evaluated at once.
        samples: Samples that are read as they are.
        most_reads: Stretches that are evaluated, at most.

    Attributes:
        reads: How many stretches were evaluated so far.
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
        self._leaf = samples * max((source.channel["dt"] for source in sources.values()), default=0)
        self.reach = past or 0, future or 0
        self.reads = 0
        self.coverage = 1.0
        self.false_a_year = 0.0

    def pieces(self, window: Window) -> Iterator[StoredPiece]:
        """Verdicts of a window in order of time, until too many stretches were evaluated.

        Raises:
            QueryError: The window, or moments in it, are too far from 1970.
        """
        if window.start < -MAX_MOMENT or window.end > MAX_MOMENT:
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
        self.reads += 1
        if self.reads > self._most_reads:
            return
        found, exact = self._evaluated(window)
        for pieces, is_open in _regions(_within(found, window), 0 if exact else self._leaf):
            if exact or not is_open:
                yield from self._explained(found, pieces, exact=exact)
                continue
            first, last = pieces[0].first, pieces[-1].last
            for part in _parts(Window(first // 2, last // 2 + 1), window):
                for piece in self._solve(part):
                    begin, end = max(piece.first, first), min(piece.last, last)
                    if begin <= end:
                        yield piece._replace(first=begin, last=end)
                if self.reads > self._most_reads:
                    return

    def _explained(
        self, found: Verdicts, pieces: list[StoredPiece], *, exact: bool
    ) -> Iterator[StoredPiece]:
        """Stretches with all that is stated of them."""
        possible = [piece for piece in pieces if piece.verdict is Verdict.POSSIBLE]
        if not possible and self.coverage == 1.0:
            yield from pieces
            return
        ends = np.array([(piece.first, piece.last) for piece in possible], np.int64).reshape(-1, 2)
        causes = iter(found.causes(ends[:, 0], ends[:, 1]))
        for piece in pieces:
            coverage = self._coverage(found, piece, exact=exact)
            if piece.verdict is Verdict.POSSIBLE:
                changes = found.most_changes(piece.first, piece.last)
                yield piece._replace(because=next(causes), coverage=coverage, changes=changes)
            else:
                yield piece._replace(coverage=coverage)

    def _coverage(self, found: Verdicts, piece: StoredPiece, *, exact: bool) -> float:
        """That of its middle; a run stands for many samples, so they are counted there."""
        if self.coverage == 1.0:
            return 1.0
        middle = (piece.first + piece.last) // 4
        if not exact and found.coverage(middle) < 1.0:
            found = self._evaluated(Window(middle, middle + 1))[0]
        return found.coverage(middle)

    def _evaluated(self, window: Window) -> tuple[Verdicts, bool]:
        past, future = self.reach
        around = Window(max(window.start - past, -MAX_MOMENT), min(window.end + future, MAX_MOMENT))
        # A stretch as short as the horizon does not become shorter with its parts.
        least = _FINER * max(past + future, *(self._step(each) for each in self._sources.values()))
        last = window.span <= least
        read, signals, spans, exact, missed = {}, {}, {}, True, []
        for name, source in self._sources.items():
            most = self._samples * (_FIRST_SAMPLES if self.reads == 1 else 1)
            most = MOST_SAMPLES if last else most
            pieces, whole = self._read(source, around, most)
            read[name] = pieces, whole
            exact = exact and (whole or last)
            missed.append(union_coverage(pieces.coverage.min(initial=1.0), n=int(pieces.n.sum())))
        if self.reads == 1:
            self.coverage = union_coverage(*missed)
            if self.coverage < 1.0:
                self.false_a_year = self._false_a_year(
                    {name: each for name, (each, _) in read.items()}
                )
        try:
            for name, (pieces, whole) in read.items():
                unit, within = self._sources[name].channel["unit"], None if whole else around
                signals[name] = as_signal(pieces, unit, within=within)
                spans[name] = 0 if whole else signals[name].period
            for name, node in self._formula.deviations.items():
                known = signals[node.source]
                signals[name] = deviation(known, node.prediction, spans[node.source])
            return evaluate(self._formula, signals), exact
        except MonitorError as error:
            raise QueryError("formula", str(error)) from error

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

    def _read(self, source: ChannelSource, around: Window, most: int) -> tuple[Aggregates, bool]:
        """A channel in and around a window, and whether it is read as single samples."""
        channel = source.channel
        if channel["t_first"] is None or around.span // max(channel["dt"], 1) <= most:
            return read_around(source, around), True
        margin = 4 * around.span // self._points + self._step(source)
        wide = Window(around.start - margin, around.end + margin)
        pieces = read_hulls(source.connection, channel, wide, self._points)[0]
        if int(pieces.n.sum()) <= most:  # most of it is a gap, or was sampled more slowly
            return read_around(source, around), True
        return pieces, False

    @staticmethod
    def _step(source: ChannelSource) -> int:
        return 3 * max(int(source.channel["dt"]), 1)


def as_signal(pieces: Aggregates, unit: str, *, within: Window | None = None) -> Signal:
    """Runs of samples as samples of a signal.

    A run begins at its first sample's moment, within the time error. It holds until the next one,
    and before a gap for as long as its last sample: so its period reaches from its first sample on.

    Args:
        pieces: The runs.
        unit: Of their bounds.
        within: Where other samples may hold that are not among them: before the first run, and
            from the last sample on, any value is possible.
    """
    if np.any(pieces.first[1:] == pieces.first[:-1]):
        pieces = pieces.grouped(pieces.first)
    earliest, latest = _enclosures(pieces)
    reached = (earliest < MAX_MOMENT) & (latest > -MAX_MOMENT)
    if not np.all(reached):
        pieces, earliest, latest = pieces[reached], earliest[reached], latest[reached]
    earliest = np.maximum.accumulate(earliest) if len(pieces) else earliest
    latest = np.maximum(latest, earliest)
    period = np.maximum(pieces.last - pieces.first + pieces.dt, 1)
    whole = (pieces.breaks == 0) & (period <= MAX_BOUND)
    period = np.minimum(period, MAX_BOUND)
    lo, hi = np.where(whole, pieces.lo, -np.inf), np.where(whole, pieces.hi, np.inf)
    gap = np.append(pieces.first[1:] - pieces.last[:-1] > longest_step(pieces.dt[:-1]), False)
    gap = gap[: len(pieces)]
    until = None
    if within is not None:
        begin = max(int(min(within.start, *earliest[:1])) - 1, -MAX_MOMENT)
        # Samples that are not read come after the last one that is, whenever that was taken.
        after = pieces.last[-1:] - pieces.error[-1:], pieces.last[-1:] + pieces.error[-1:]
        first = min(int(max(begin, *earliest[-1:], *after[0])), MAX_MOMENT)
        last = min(int(max(begin, *latest[-1:], *after[1])) + 1, MAX_MOMENT)
        pads = (
            *((begin, first), (begin, last)),
            *((-np.inf, -np.inf), (np.inf, np.inf), (1, 1), (0, 0)),
        )
        columns = earliest, latest, lo, hi, period, gap
        earliest, latest, lo, hi, period, gap = (
            np.concatenate([[before], column, [after]]).astype(column.dtype)
            for column, (before, after) in zip(columns, pads, strict=True)
        )
        until = min(max(last, within.end) + 1, MAX_MOMENT)
    coverage = float(pieces.coverage.min(initial=1.0))
    return Signal(earliest, latest, lo, hi, period, gap, unit=unit, coverage=coverage, until=until)


def _enclosures(pieces: Aggregates) -> tuple[Integers, Integers]:
    """The earliest and the latest moment of each first sample, in the range of formulas."""
    first, error = pieces.first, pieces.error
    low, high = first < error - MAX_MOMENT, first > MAX_MOMENT - error
    earliest = np.where(low, -MAX_MOMENT, first - error)
    latest = np.where(high, MAX_MOMENT, first + error)
    return np.minimum(earliest, MAX_MOMENT), np.maximum(latest, -MAX_MOMENT)


def _within(found: Verdicts, window: Window) -> Iterator[tuple[StoredPiece, bool]]:
    """The verdicts in a window, and whether samples that exist may decide one that is possible."""
    begin, end = 2 * window.start, 2 * window.end - 1
    if begin > end:
        return
    held, failed = found.held_by_samples(), found.failed_by_samples()
    edges = [np.array([begin, end + 1]), found.ticks]
    for runs in (held, failed):
        edges += [runs.first, runs.last[runs.last < end] + 1]
    ticks = np.unique(np.concatenate(edges))
    first = ticks[(ticks >= begin) & (ticks <= end)]
    codes = found.codes_at_ticks(first)
    possible = codes == Verdict.POSSIBLE
    is_held, is_failed = held.contains(first), failed.contains(first)
    missing, is_open = possible & ~is_held, possible & (is_held | is_failed)
    cut = np.flatnonzero(np.diff(codes + 4 * missing + 8 * is_open, prepend=-1))
    first = first[cut]
    last = np.append(first[1:] - 1, end)
    for k, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        verdict, lost = Verdict(int(codes[cut[k]])), bool(missing[cut[k]])
        piece = StoredPiece(
            a, b, verdict, missing=lost, because=Because(0), coverage=1.0, changes=0
        )
        yield piece, bool(is_open[cut[k]])


def _regions(
    pieces: Iterable[tuple[StoredPiece, bool]], near: int
) -> Iterator[tuple[list[StoredPiece], bool]]:
    """Runs of stretches that are all decided, or are evaluated again together.

    Open stretches that lie nearer to each other than so many ns are read at once.
    """
    region: list[StoredPiece] = []  # begins and ends with an open stretch
    decided: list[StoredPiece] = []
    for piece, is_open in pieces:
        if not is_open:
            decided.append(piece)
            continue
        if region and piece.first - region[-1].last > 2 * near:
            yield region, True
            region = []
        if not region and decided:
            yield decided, False
        region = [*region, *decided, piece] if region else [piece]
        decided = []
    if region:
        yield region, True
    if decided:
        yield decided, False


def _parts(stretch: Window, window: Window) -> Iterator[Window]:
    """A stretch in parts that are so short that shorter runs are read of them."""
    length = max(window.span // _FINER, 1)
    for start in range(stretch.start, stretch.end, length):
        yield Window(start, min(start + length, stretch.end))
