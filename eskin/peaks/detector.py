"""The search for peaks in pure Python: for microcontrollers, and what the kernel is held to."""

from __future__ import annotations

from dataclasses import dataclass
from math import fsum, inf, isnan, nextafter
from typing import TYPE_CHECKING

from eskin.peaks.event import PeakEvent, Verdict, no_interval, require_prominence

if TYPE_CHECKING:
    from collections.abc import Iterable

_MOST_REGIONS = 8


@dataclass(slots=True)
class _Span:
    """What a stretch of samples has in common: ends, extremes, and the peaks found in it."""

    first: int
    last: int
    lowest: float
    floor: float
    ceiling: float
    peaks: int = 0
    prominence: float = 0.0

    def take(self, index: int, lo: float, hi: float) -> None:
        self.last = index
        self.lowest = min(self.lowest, lo)
        self.floor = max(self.floor, lo)
        self.ceiling = max(self.ceiling, hi)

    def merge(self, later: _Span) -> None:
        self.last = later.last
        self.lowest = min(self.lowest, later.lowest)
        self.floor = max(self.floor, later.floor)
        self.ceiling = max(self.ceiling, later.ceiling)
        self.peaks += later.peaks

    def event(self, verdict: Verdict) -> PeakEvent:
        return PeakEvent(
            verdict=verdict,
            first=self.first,
            last=self.last,
            count=(1, 1) if verdict is Verdict.CERTAIN else (0, self.peaks),
            height=(self.floor, self.ceiling),
            prominence=(self.prominence, nextafter(self.ceiling - self.lowest, inf)),
        )


class _Hysteresis:
    """One pass: a rise of p above the lowest valley, then a fall of p below the highest crest."""

    __slots__ = ("_crest", "_prominence", "_rising", "_valley", "span")

    def __init__(self, prominence: float) -> None:
        self._prominence = prominence
        self.reset()

    def reset(self) -> None:
        self._valley = inf
        self._crest = -inf
        self._rising = False
        self.span: _Span | None = None

    def take(self, index: int, valley: float, crest: float, lo: float, hi: float) -> _Span | None:
        """Take the next sample; give the stretch from a to c where it completes a peak."""
        if self.span is None:
            self._start(index, valley, lo, hi)
            return None
        self.span.take(index, lo, hi)
        if self._rising:
            if self._reaches(self._crest, valley):
                return self._complete(index, valley, lo, hi)
            self._crest = max(self._crest, crest)
        elif self._reaches(crest, self._valley):
            self._rising, self._crest = True, crest
        elif valley <= self._valley:
            self._start(index, valley, lo, hi)
        return None

    def _start(self, index: int, valley: float, lo: float, hi: float) -> None:
        self._valley, self._rising = valley, False
        self.span = _Span(index, index, lo, lo, hi)

    def _complete(self, index: int, valley: float, lo: float, hi: float) -> _Span | None:
        done = self.span
        if done is not None:
            done.peaks = 1
            done.prominence = nextafter(self._crest - max(self._valley, valley), -inf)
        self._start(index, valley, lo, hi)
        return done

    def _reaches(self, high: float, low: float) -> bool:
        """Whether ``high - low >= p``, exactly: only a tie can hide behind the rounding."""
        difference = high - low
        if difference == self._prominence:
            return fsum((high, -low, -self._prominence)) >= 0.0
        return difference > self._prominence


class PeakDetector:
    """Finds the peaks of a tube that arrives in pieces, in constant memory and pure Python.

    `eskin.PeakStream` gives the same events, a hundred times as fast, where numba runs.

    Args:
        prominence: Least prominence p > 0, in the signal's unit.
        longest_region: Samples after which undecided regions are reported as possible; ``None``
            waits for the end. The search goes on: a peak reported like this may still prove
            certain and is reported again then, so that the number of certain ones stays exact and
            the number of possible ones an upper bound.

    Raises:
        ValueError: The prominence is not positive and finite.
    """

    def __init__(self, prominence: float, *, longest_region: int | None = None) -> None:
        require_prominence(prominence)
        self._longest = longest_region
        self._index = 0
        self._certain = _Hysteresis(prominence)
        self._optimistic = _Hysteresis(prominence)
        self._undecided: list[_Span] = []

    def feed(self, lows: Iterable[float], highs: Iterable[float]) -> list[PeakEvent]:
        """Take the next samples, in order.

        Args:
            lows: Lower bounds; ``-inf`` where unbounded, NaN where a sample is missing: a gap.
            highs: Upper bounds, as many; ``inf`` where unbounded, NaN where a sample is missing.

        Returns:
            What is decided now, in order of its end. Indices count all samples since the start,
            over gaps too.

        Raises:
            IntervalError: Bounds are no interval. The search stands before them, and what this
                call found is lost.
            ValueError: The bounds differ in number.
        """
        events: list[PeakEvent] = []
        for lo, hi in zip(lows, highs, strict=True):
            if lo <= hi and lo < inf and hi > -inf:
                self._take(lo, hi, events)
            elif isnan(lo) or isnan(hi):
                events += self.gap()
            else:
                raise no_interval(self._index, lo, hi)
            self._index += 1
        return events

    def gap(self, samples: int = 0) -> list[PeakEvent]:
        """Say that ``samples`` samples are missing here; nothing is joined across."""
        events = [span.event(Verdict.POSSIBLE) for span in self._undecided]
        self._undecided.clear()
        self._certain.reset()
        self._optimistic.reset()
        self._index += samples
        return events

    def finish(self) -> list[PeakEvent]:
        """Say that the signal ends; what is undecided is possible."""
        return self.gap()

    def _take(self, lo: float, hi: float, events: list[PeakEvent]) -> None:
        possible = self._optimistic.take(self._index, lo, hi, lo, hi)
        if possible is not None:
            self._remember(possible)
        certain = self._certain.take(self._index, hi, lo, lo, hi)
        if certain is not None:
            self._match(certain)
        if self._undecided:
            self._settle(events)
        if certain is not None:
            events.append(certain.event(Verdict.CERTAIN))

    def _remember(self, span: _Span) -> None:
        span.prominence = 0.0
        waiting = self._undecided
        if waiting and span.first <= waiting[-1].last:
            waiting[-1].merge(span)
        else:
            waiting.append(span)
            if len(waiting) > _MOST_REGIONS:
                waiting[0].merge(waiting.pop(1))

    def _match(self, certain: _Span) -> None:
        """Take the peak that proved certain out of the undecided ones.

        There always is one, unless it was reported as possible before, for taking too long.
        """
        within = [span for span in self._undecided if span.last > certain.first]
        if not within:
            return
        best = max(within, key=lambda span: span.ceiling)
        best.peaks -= 1
        if best.peaks == 0:
            self._undecided.remove(best)

    def _settle(self, events: list[PeakEvent]) -> None:
        """Report regions that no certain peak can claim any more, and that will not grow."""
        if self._longest is not None and self._index - self._undecided[0].first >= self._longest:
            events.extend(span.event(Verdict.POSSIBLE) for span in self._undecided)
            self._undecided.clear()
            return
        certain, growing = self._certain.span, self._optimistic.span
        while self._undecided:
            span = self._undecided[0]
            claimable = certain is None or span.last > certain.first
            touching = growing is None or span.last >= growing.first
            if claimable or touching:
                return
            events.append(self._undecided.pop(0).event(Verdict.POSSIBLE))
