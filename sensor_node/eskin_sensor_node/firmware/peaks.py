"""Peaks of a tube, certain and possible, in constant memory.

For a prominence p and samples ``[lo_k, hi_k]`` a certain peak is a < b < c with
``lo_b - hi_a >= p`` and ``lo_b - hi_c >= p``: every signal inside has a peak of that prominence
between a and c. The same search on the optimistic side (``hi_b - lo_a``, ``hi_b - lo_c``) counts
the peaks that some signal has; what it finds beyond the certain ones is possible.

The same events as those of `eskin.peaks`, which is compiled: tests hold it to this.
"""

from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

POSSIBLE = 1
CERTAIN = 2
_MOST_REGIONS = 8


class PeakEvent:
    """One certain peak, or a region with a number of possible ones.

    Attributes:
        verdict: `CERTAIN` or `POSSIBLE`.
        first: Index of the sample a before the peak.
        last: Index of the sample c after the peak.
        count: ``(1, 1)`` if certain, ``(0, n)`` if possible.
        height: Bounds of the greatest value between first and last, in the signal's unit.
        prominence: Bounds of the height above the higher of the two lowest points beside it.
    """

    __slots__ = ("count", "first", "height", "last", "prominence", "verdict")

    def __init__(self, verdict: int, span: "Span") -> None:
        self.verdict = verdict
        self.first = span.first
        self.last = span.last
        self.count = (1, 1) if verdict == CERTAIN else (0, span.peaks)
        self.height = (span.floor, span.ceiling)
        self.prominence = (span.prominence, up(span.ceiling - span.lowest))


class Span:
    """What a stretch of samples has in common: ends, extremes, and the peaks found in it."""

    __slots__ = ("ceiling", "first", "floor", "last", "lowest", "peaks", "prominence")

    def __init__(self, index: int, lo: float, hi: float) -> None:
        self.first = self.last = index
        self.lowest = self.floor = lo
        self.ceiling = hi
        self.peaks = 0
        self.prominence = 0.0

    def take(self, index: int, lo: float, hi: float) -> None:
        """Take a sample in; comparisons, since calls of ``min`` take three times as long."""
        self.last = index
        if lo < self.lowest:
            self.lowest = lo
        elif lo > self.floor:
            self.floor = lo
        self.ceiling = max(self.ceiling, hi)

    def merge(self, later: "Span") -> None:
        """Take a later stretch in."""
        self.last = later.last
        self.lowest = min(self.lowest, later.lowest)
        self.floor = max(self.floor, later.floor)
        self.ceiling = max(self.ceiling, later.ceiling)
        self.peaks += later.peaks


class Hysteresis:
    """One pass: a rise of p above the lowest valley, then a fall of p below the highest crest.

    Attributes:
        span: The stretch from its valley on; ``None`` before the first sample.
        valley: The lowest valley so far.
        crest: The highest crest since it rose.
        rising: Whether it rose p above the valley.
    """

    __slots__ = ("_prominence", "crest", "rising", "span", "valley")

    def __init__(self, prominence: float) -> None:
        self._prominence = prominence
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self.valley = INFINITY
        self.crest = -INFINITY
        self.rising = False
        self.span: Span | None = None

    def take(self, index: int, valley: float, crest: float, lo: float, hi: float) -> "Span | None":
        """Take the next sample; give the stretch from a to c where it completes a peak."""
        span = self.span
        if span is None:
            self._start(index, valley, lo, hi)
            return None
        span.take(index, lo, hi)
        if self.rising:
            if reaches(self.crest, valley, self._prominence):
                span.peaks = 1
                span.prominence = down(self.crest - max(self.valley, valley))
                self._start(index, valley, lo, hi)
                return span
            self.crest = max(self.crest, crest)
        elif reaches(crest, self.valley, self._prominence):
            self.rising, self.crest = True, crest
        elif valley <= self.valley:
            self._start(index, valley, lo, hi)
        return None

    def _start(self, index: int, valley: float, lo: float, hi: float) -> None:
        self.valley, self.rising = valley, False
        self.span = Span(index, lo, hi)


def reaches(high: float, low: float, prominence: float) -> bool:
    """Whether ``high - low >= prominence``, exactly: only a tie can hide behind the rounding."""
    difference = high - low
    if difference != prominence:
        return difference > prominence
    # What the rounding of the difference left out (Knuth's two-sum).
    back = difference - high
    return (high - (difference - back)) - (low + back) >= 0.0


class PeakDetector:
    """Finds the peaks of a tube that arrives in pieces.

    Args:
        prominence: Least prominence p > 0, in the signal's unit.
        longest: Samples after which an undecided region is reported as possible. The search goes
            on: such a peak may still prove certain and is reported again then.
        first: Index of the first sample.

    Attributes:
        index: Of the next sample.
        certain: The pass that finds certain peaks.
        optimistic: The pass that finds all that may be.
        undecided: Possible peaks that may still prove certain, the oldest first.
    """

    def __init__(self, prominence: float, longest: int, first: int = 0) -> None:
        self._longest = longest
        self.index = first
        self.certain = Hysteresis(prominence)
        self.optimistic = Hysteresis(prominence)
        self.undecided: list[Span] = []

    def feed(self, lows: "Sequence[float]", highs: "Sequence[float]", n: int) -> "list[PeakEvent]":
        """Take the next samples; give what is decided now, in order of its end.

        A sample of which a bound is no number is missing: a gap.
        """
        events: list[PeakEvent] = []
        for k in range(n):
            if lows[k] == lows[k] and highs[k] == highs[k]:
                self._take(lows[k], highs[k], events)
            else:
                events += self.gap(0)
            self.index += 1
        return events

    def gap(self, samples: int) -> "list[PeakEvent]":
        """Skip missing samples; no peak is joined across."""
        events = [PeakEvent(POSSIBLE, span) for span in self.undecided]
        self.undecided.clear()
        self.certain.reset()
        self.optimistic.reset()
        self.index += samples
        return events

    def _take(self, lo: float, hi: float, events: "list[PeakEvent]") -> None:
        possible = self.optimistic.take(self.index, lo, hi, lo, hi)
        if possible is not None:
            self._remember(possible)
        certain = self.certain.take(self.index, hi, lo, lo, hi)
        if certain is not None:
            self._match(certain)
        if self.undecided:
            self._settle(events)
        if certain is not None:
            events.append(PeakEvent(CERTAIN, certain))

    def _remember(self, span: Span) -> None:
        span.prominence = 0.0
        waiting = self.undecided
        if waiting and span.first <= waiting[-1].last:
            waiting[-1].merge(span)
            return
        waiting.append(span)
        if len(waiting) > _MOST_REGIONS:
            waiting[0].merge(waiting.pop(1))

    def _match(self, certain: Span) -> None:
        """Take the peak that proved certain out of the undecided ones.

        There always is one, unless it was reported as possible before, for taking too long.
        """
        best = None
        for span in self.undecided:
            if span.last > certain.first and (best is None or span.ceiling > best.ceiling):
                best = span
        if best is None:
            return
        best.peaks -= 1
        if best.peaks == 0:
            self.undecided.remove(best)

    def _settle(self, events: "list[PeakEvent]") -> None:
        """Report regions that no certain peak can claim any more, and that will not grow."""
        waiting = self.undecided
        if self.index - waiting[0].first >= self._longest:
            events.extend(PeakEvent(POSSIBLE, span) for span in waiting)
            waiting.clear()
            return
        certain, growing = self.certain.span, self.optimistic.span
        while waiting:
            claimable = certain is None or waiting[0].last > certain.first
            touching = growing is None or waiting[0].last >= growing.first
            if claimable or touching:
                return
            events.append(PeakEvent(POSSIBLE, waiting.pop(0)))
