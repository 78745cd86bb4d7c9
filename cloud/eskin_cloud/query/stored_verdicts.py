"""A formula over stored channels: by hulls where they decide it, else by samples.

The hull of consecutive samples holds all of them. So a run of samples is read as one sample, whose
value lies in the hull and is held until the next run begins; a run with a gap in it has any value.
Verdicts by runs are those of the samples, or possible. Stretches that stay possible are evaluated
again by shorter runs, down to single samples.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.errors import MonitorError, QueryError
from eskin.interval import Verdict
from eskin.monitor import Because, Signal, check, evaluate
from eskin.monitor.signal import MAX_MOMENT
from eskin_cloud.query.neighbourhood import read_around
from eskin_cloud.rollup.aggregates import longest_step
from eskin_cloud.rollup.hulls import read_hulls
from eskin_cloud.store.read.window import Window

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from eskin.monitor import Formula, Verdicts
    from eskin_cloud.query.neighbourhood import ChannelSource
    from eskin_cloud.rollup.aggregates import Aggregates

POINTS: Final = 1024
"""Runs of a channel that are evaluated at once."""
SAMPLES: Final = 16_384
"""Samples that are read as they are."""
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
        because: Why it is possible; nothing where it is not.
        coverage: Probability with which the verdict is right in its middle, at least.
    """

    first: int
    last: int
    verdict: Verdict
    because: Because
    coverage: float


class StoredVerdicts:
    """Evaluates a formula over stored channels.

    Args:
        formula: All its windows must be bounded.
        sources: Where each of its channels is read, by its name in the formula.
        points: Runs of a channel that are evaluated at once.
        samples: Samples that are read as they are.

    Attributes:
        reads: How many stretches were evaluated so far.
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
    ) -> None:
        units = {name: source.channel["unit"] for name, source in sources.items()}
        try:
            past, future = check(formula, units, bounded=True)
        except MonitorError as error:
            raise QueryError("formula", str(error)) from error
        self._formula, self._sources = formula, sources
        self._points, self._samples = points, samples
        self.reach = past or 0, future or 0
        self.reads = 0

    def pieces(self, window: Window) -> Iterator[StoredPiece]:
        """Verdicts of a window in order of time, until `MOST_READS` stretches were evaluated.

        Raises:
            QueryError: The window, or moments in it, are too far from 1970.
        """
        if window.start < -MAX_MOMENT or window.end > MAX_MOMENT:
            raise QueryError("start, end", "formulas are evaluated within 109 years of 1970")
        waiting: StoredPiece | None = None
        for piece in self._solve(window):
            if waiting is None:
                waiting = piece
            elif (piece.verdict, piece.because) == (waiting.verdict, waiting.because):
                coverage = min(waiting.coverage, piece.coverage)
                waiting = waiting._replace(last=piece.last, coverage=coverage)
            else:
                yield waiting
                waiting = piece
        if waiting is not None:
            yield waiting

    def _solve(self, window: Window) -> Iterator[StoredPiece]:
        self.reads += 1
        if self.reads > MOST_READS:
            return
        found, exact = self._evaluated(window)
        for first, last, verdict in _within(found, window):
            if verdict is not Verdict.POSSIBLE or exact:
                middle = (first + last) // 4
                because = found.because(middle) if verdict is Verdict.POSSIBLE else Because(0)
                yield StoredPiece(first, last, verdict, because, found.coverage(middle))
                continue
            for part in _parts(Window(first // 2, last // 2 + 1), window):
                for piece in self._solve(part):
                    begin, end = max(piece.first, first), min(piece.last, last)
                    if begin <= end:
                        yield piece._replace(first=begin, last=end)
                if self.reads > MOST_READS:
                    return

    def _evaluated(self, window: Window) -> tuple[Verdicts, bool]:
        past, future = self.reach
        around = Window(max(window.start - past, -MAX_MOMENT), min(window.end + future, MAX_MOMENT))
        # A stretch as short as the horizon does not become shorter with its parts.
        least = _FINER * max(past + future, *(self._step(each) for each in self._sources.values()))
        last = window.span <= least
        signals, exact = {}, True
        for name, source in self._sources.items():
            pieces, whole = self._read(source, around, MOST_SAMPLES if last else self._samples)
            exact = exact and (whole or last)
            signals[name] = as_signal(pieces, source.channel["unit"])
        try:
            return evaluate(self._formula, signals), exact
        except MonitorError as error:
            raise QueryError("formula", str(error)) from error

    def _read(self, source: ChannelSource, around: Window, most: int) -> tuple[Aggregates, bool]:
        """A channel in and around a window, and whether each of its runs is one sample."""
        channel = source.channel
        if channel["t_first"] is None or around.span // max(channel["dt"], 1) <= most:
            return read_around(source, around), True
        margin = 4 * around.span // self._points + self._step(source)
        wide = Window(around.start - margin, around.end + margin)
        return read_hulls(source.connection, channel, wide, self._points)[0], False

    @staticmethod
    def _step(source: ChannelSource) -> int:
        return 3 * max(int(source.channel["dt"]), 1)


def as_signal(pieces: Aggregates, unit: str) -> Signal:
    """Runs of samples as samples of a signal.

    A run begins at its first sample's moment, within the time error. It holds until the next one,
    and before a gap for as long as its last sample: so its period reaches from its first sample on.
    """
    pieces = pieces.grouped(pieces.first)
    whole = pieces.breaks == 0
    error = pieces.error
    earliest = np.maximum.accumulate(pieces.first - error) if len(pieces) else pieces.first
    gap = np.append(pieces.first[1:] - pieces.last[:-1] > longest_step(pieces.dt[:-1]), False)
    return Signal(
        earliest,
        np.maximum(pieces.first + error, earliest),
        np.where(whole, pieces.lo, -np.inf),
        np.where(whole, pieces.hi, np.inf),
        np.maximum(pieces.last - pieces.first + pieces.dt, 1),
        gap[: len(pieces)],
        unit=unit,
        coverage=float(pieces.coverage.min(initial=1.0)),
    )


def _within(found: Verdicts, window: Window) -> Iterator[tuple[int, int, Verdict]]:
    """First and last ticks of the verdicts in a window."""
    begin, end = 2 * window.start, 2 * window.end - 1
    edges = np.append(found.ticks[1:], [2**63 - 1])
    for k in np.flatnonzero((edges > begin) & (found.ticks <= end)).tolist():
        first, last = max(int(found.ticks[k]), begin), min(int(edges[k]) - 1, end)
        if first <= last:
            yield first, last, Verdict(int(found.codes[k]))


def _parts(stretch: Window, window: Window) -> Iterator[Window]:
    """A stretch in parts that are so short that shorter runs are read of them."""
    length = max(window.span // _FINER, 1)
    for start in range(stretch.start, stretch.end, length):
        yield Window(start, min(start + length, stretch.end))
