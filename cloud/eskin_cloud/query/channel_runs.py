"""A channel as runs of samples, shorter where it matters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from eskin.monitor import Signal
from eskin.monitor.formula import MAX_BOUND
from eskin.monitor.signal import MAX_INSTANT
from eskin.wire.timestamp import MOST_INSTANT
from eskin_cloud.rollup.aggregates import EMPTY, concatenated, longest_step
from eskin_cloud.rollup.hulls import read_ranges
from eskin_cloud.rollup.ranges import merged
from eskin_cloud.rollup.samples import read_samples
from eskin_cloud.store.read.patch_columns import next_rows, previous_rows
from eskin_cloud.store.read.patch_runs import ROWS_AT_ONCE
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import STEP, TOP

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray
    from sqlalchemy import Connection

    from eskin_cloud.rollup.aggregates import Aggregates, Integers
    from eskin_cloud.store.read.lookup import Channel

NEAR: Final = 64
"""Samples beside a window that are read at first."""
GROWTH: Final = 8
"""How many times as many are read next."""
_FINER: Final = 6
"""A run is replaced by those of tiles that are so many powers of two shorter: of one chunk."""
_STRETCH: Final = 2**14
"""Samples that count as a stretch that is read."""
_CHUNKS: Final = 64
"""Chunks that are read at once, at most."""
_STRETCHES: Final = 256
"""Stretches of samples that are read at once, at most."""


class ChannelSource(NamedTuple):
    """A channel, and the read transaction that holds it."""

    connection: Connection
    channel: Channel


def read_around(source: ChannelSource, window: Window) -> Aggregates:
    """The samples in and around a window, so far that no other may be valid in it.

    What is read grows on both sides until samples beside it are known to hold before the window,
    and after it. It reaches over a gap, however long, to the next rows and no further.
    """
    channel = source.channel
    if channel["t_first"] is None:
        return EMPTY
    margin = NEAR * max(channel["dt"], 1)
    wide = Window(max(window.start - margin, -MOST_INSTANT), min(window.end + margin, MOST_INSTANT))
    while True:
        samples = read_samples(source.connection, channel, wide)
        earliest = samples.first - samples.error
        sure = earliest[samples.first + samples.error <= window.start]
        after = wide.end > channel["t_last"] or bool(np.any(earliest >= window.end))
        before = wide.start <= channel["t_first"] or bool(
            sure.size and samples.first[0] <= sure.max()
        )
        if after and before:
            return samples
        wide = Window(
            wide.start if before else earlier(source, wide.start, margin),
            wide.end if after else later(source, wide.end, margin),
        )
        margin *= GROWTH


def earlier(source: ChannelSource, start: int, margin: int) -> int:
    """Since when to read, for more samples before a time, and so many ns at least."""
    rows = previous_rows(source.connection, source.channel, start)
    found = source.channel["t_first"] if rows is None else min(rows, start - margin)
    return int(max(found, -MOST_INSTANT))


def later(source: ChannelSource, end: int, margin: int) -> int:
    """Until when to read, for more samples from a time on, and so many ns at least."""
    rows = next_rows(source.connection, source.channel, end)
    found = source.channel["t_last"] if rows is None else max(rows, end + margin)
    return int(min(found + 1, MOST_INSTANT))


@dataclass(frozen=True, slots=True)
class ChannelRuns:
    """What is read of a channel.

    Where other samples exist before or after these, they count as a run more on that side, which
    has any value.

    Attributes:
        source: Where it is read.
        pieces: Runs of samples that follow each other; each is of one tile, or a single sample.
        begin: All samples from this time on, UTC ns,
        end: and before this one are in them.
        margin: So far beside them it is read next, ns.
    """

    source: ChannelSource
    pieces: Aggregates
    begin: int
    end: int
    margin: int

    @classmethod
    def first(cls, source: ChannelSource, around: Window, points: int, most: int) -> ChannelRuns:
        """Those in and around a window.

        Args:
            source: Where the channel is read.
            around: The window.
            points: Runs, at most.
            most: Samples that are read as they are.
        """
        channel = source.channel
        margin = NEAR * max(channel["dt"], 1)
        if channel["t_first"] is None:
            return cls(source, EMPTY, around.start, around.end, margin)
        begin = max(around.start - margin, channel["t_first"])
        end = min(around.end + margin, channel["t_last"] + 1)
        begin = min(begin, channel["t_last"] + 1)
        end = max(begin, end)
        if (end - begin) // max(channel["dt"], 1) <= most:
            pieces = read_samples(source.connection, channel, Window(begin, end))
            return cls(source, distinct(pieces), begin, end, margin)
        level = 0
        while level < TOP and (end - begin) >> level > points:
            level += STEP
        tiles = begin >> level, ((end - 1) >> level) + 1
        pieces = read_ranges(source.connection, channel, level, [tiles])
        begin, end = (number << level for number in tiles)
        return cls(source, distinct(pieces), begin, end, margin)

    @classmethod
    def around(cls, source: ChannelSource, window: Window) -> ChannelRuns:
        """All samples that may be valid in a window."""
        pieces = distinct(read_around(source, window))
        return cls(source, pieces, -MOST_INSTANT, MOST_INSTANT, 1)

    @property
    def dt(self) -> int:
        """Its period, ns."""
        return max(int(self.source.channel["dt"]), 1)

    @property
    def _more(self) -> tuple[bool, bool]:
        """Whether samples exist before these, and after the instant of the last one.

        A run of several holds until its last sample.
        """
        first, last = (self.source.channel[name] for name in ("t_first", "t_last"))
        if first is None:
            return False, False
        several = self.pieces.last[-1:] > self.pieces.first[-1:]
        return self.begin > first, self.end <= last or bool(several.any())

    @property
    def are_several(self) -> NDArray[np.bool_]:
        """Of each sample of the signal, whether it stands for several samples."""
        before, after = self._more
        mine = self.pieces.last > self.pieces.first
        return np.concatenate([[True] * before, mine, [True] * after]).astype(np.bool_)

    def signal(self, around: Window) -> Signal:
        """Each run as a sample; any value may hold in a window where other samples may."""
        before, after = self._more
        return as_signal(
            self.pieces,
            self.source.channel["unit"],
            before=around.start if before else None,
            after=around.end if after else None,
        )

    def since(self, instant: int) -> ChannelRuns:
        """Without the runs that are known to hold no longer at an instant."""
        earliest = self.pieces.first - self.pieces.error
        begun = self.pieces.first + self.pieces.error <= instant
        if not np.any(begun):
            return self
        known = np.searchsorted(self.pieces.first, earliest[begun].max(), side="right") - 1
        if known <= 0:
            return self
        pieces = self.pieces[int(known) :]
        return replace(self, pieces=pieces, begin=int(pieces.first[0]))

    def finer(self, wanted: NDArray[np.bool_], samples: int, most: int) -> tuple[ChannelRuns, int]:
        """Replace the first of some runs by shorter ones.

        Args:
            wanted: Which samples of the signal; single ones stay.
            samples: Samples of a run that are read as they are.
            most: Samples that are read, at most; of one run, whatever it takes.

        Returns:
            The runs, and how many stretches of 2^14 samples or fewer were read for them.
        """
        runs, (before, after) = self.pieces, self._more
        mine = (wanted & self.are_several)[int(before) : wanted.size - int(after)]
        if after and wanted[-1] and self.end > self.source.channel["t_last"]:
            mine[-1], after = True, False
        chosen = np.flatnonzero(mine)
        count = runs.n[chosen]
        cost = np.where(count <= samples, np.maximum(count, most // _STRETCHES), most // _CHUNKS)
        chosen = chosen[: max(int(np.searchsorted(np.cumsum(cost), most, side="right")), 1)]
        kept = np.ones(len(runs), np.bool_)
        kept[chosen] = False
        found = [(runs[kept], 0), *self._shorter(chosen, samples, most)]
        begin, end, margin = self.begin, self.end, self.margin
        if before and wanted[0]:
            begin = earlier(self.source, self.begin, margin)
            found.append(self._samples(Window(begin, self.begin)))
        if after and wanted[-1]:
            end = later(self.source, self.end, margin)
            found.append(self._samples(Window(self.end, end)))
        if (begin, end) != (self.begin, self.end):
            margin *= GROWTH
        pieces = distinct(concatenated([each for each, _ in found]))
        reads = sum(count + len(each) // _STRETCH for each, count in found[1:])
        return ChannelRuns(self.source, pieces, begin, end, margin), reads

    def _shorter(
        self, chosen: NDArray[np.intp], samples: int, most: int
    ) -> Iterator[tuple[Aggregates, int]]:
        """Shorter runs instead of some, of tiles or single samples; and of how many stretches."""
        runs, channel = self.pieces[chosen], self.source.channel
        # All of a run lies in one tile of these bits, and tiles nest.
        _, bits = np.frexp((runs.first ^ runs.last).astype(np.float64))
        level = np.maximum(bits - _FINER, channel["grain"] or 0)
        level += level % STEP
        few = (runs.n <= samples) | (level >= bits)
        yield from self._single(chosen[few], most)
        for each in np.unique(level[~few]).tolist():
            tiled = runs[~few & (level == each)]
            ends = zip((tiled.first >> each).tolist(), (tiled.last >> each).tolist(), strict=True)
            ranges = merged((first, last + 1) for first, last in ends)
            yield read_ranges(self.source.connection, channel, each, ranges), len(ranges)

    def _single(self, chosen: NDArray[np.intp], most: int) -> Iterator[tuple[Aggregates, int]]:
        """The samples of some runs; between those that lie near to each other all are read."""
        runs = self.pieces
        count = np.cumsum(runs.n)
        apart = count[chosen[1:] - 1] - count[chosen[:-1]] > most
        windows = [
            Window(int(runs.first[part[0]]), int(runs.last[part[-1]]) + 1)
            for part in np.split(chosen, np.flatnonzero(apart) + 1)
            if part.size
        ]
        for begin in range(0, len(windows), ROWS_AT_ONCE):
            read, stretches = self._samples(*windows[begin : begin + ROWS_AT_ONCE])
            run = np.searchsorted(runs.first[chosen], read.first, side="right") - 1
            yield read[read.first <= runs.last[chosen][run]], stretches

    def _samples(self, *windows: Window) -> tuple[Aggregates, int]:
        samples = read_samples(self.source.connection, self.source.channel, *windows)
        return samples, len(windows)


def as_signal(
    pieces: Aggregates, unit: str, *, before: int | None = None, after: int | None = None
) -> Signal:
    """Runs of samples as samples of a signal.

    A run begins at its first sample's instant, within the time error. It holds until the next one,
    and before a gap for as long as its last sample: so its period reaches from its first sample on.

    Args:
        pieces: The runs.
        unit: Of their bounds.
        before: Where other samples may hold that come before these, an instant before which none is
            asked for: any value is possible before the first run.
        after: Likewise of those that come after these, from the last sample on.
    """
    pieces = distinct(pieces)
    earliest, latest = _enclosures(pieces)
    earliest = np.maximum.accumulate(earliest) if len(pieces) else earliest
    latest = np.maximum(latest, earliest)
    period = np.maximum(pieces.last - pieces.first + pieces.dt, 1)
    whole = (pieces.breaks == 0) & (period <= MAX_BOUND)
    period = np.minimum(period, MAX_BOUND)
    lo, hi = np.where(whole, pieces.lo, -np.inf), np.where(whole, pieces.hi, np.inf)
    gap = np.append(pieces.first[1:] - pieces.last[:-1] > longest_step(pieces.dt[:-1]), False)
    gap = gap[: len(pieces)]
    columns = earliest, latest, lo, hi, period, gap
    until = None
    if before is not None:
        begin = max(min([before, *earliest[:1].tolist()]) - 1, -MAX_INSTANT)
        columns = _joined(((begin, begin, -np.inf, np.inf, 1, False), columns))
    if after is not None:
        # They come after the last sample that is read, whenever that was taken.
        error, ends = pieces.error[-1:], pieces.last[-1:]
        sides = (ends - error, columns[0][-1:]), (ends + error, columns[1][-1:])
        first, last = (max(int(max(each, default=-MAX_INSTANT)) for each in side) for side in sides)
        first, last = min(first, MAX_INSTANT), min(last + 1, MAX_INSTANT)
        columns = _joined((columns, (first, last, -np.inf, np.inf, 1, False)))
        until = min(max(last, after) + 1, MAX_INSTANT)
    coverage = float(pieces.coverage.min(initial=1.0))
    return Signal(*columns, unit=unit, coverage=coverage, until=until)


def distinct(pieces: Aggregates) -> Aggregates:
    """Runs that begin apart, and in the range of formulas."""
    if np.any(pieces.first[1:] == pieces.first[:-1]):
        pieces = pieces.grouped(pieces.first)
    earliest, latest = _enclosures(pieces)
    reached = (earliest < MAX_INSTANT) & (latest > -MAX_INSTANT)
    return pieces if np.all(reached) else pieces[reached]


def _joined(parts: tuple[Sequence[Any], Sequence[Any]]) -> tuple[Any, ...]:
    """Columns, and before or after each a value of its kind."""
    return tuple(np.append(*pair) for pair in zip(*parts, strict=True))


def _enclosures(pieces: Aggregates) -> tuple[Integers, Integers]:
    """The earliest and the latest instant of each first sample, in the range of formulas."""
    first, error = pieces.first, pieces.error
    low, high = first < error - MAX_INSTANT, first > MAX_INSTANT - error
    earliest = np.where(low, -MAX_INSTANT, first - error)
    latest = np.where(high, MAX_INSTANT, first + error)
    return np.minimum(earliest, MAX_INSTANT), np.maximum(latest, -MAX_INSTANT)
