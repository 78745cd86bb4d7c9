"""One quantity of one taxel: samples, baseline, smoothing and peaks."""

from array import array

from eskin_sensor_node.firmware.peaks import PeakDetector
from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.assembler import Assembler, Patch
    from eskin_sensor_node.firmware.clock import Clock
    from eskin_sensor_node.firmware.inversion import Buffer
    from eskin_sensor_node.firmware.peaks import PeakEvent
    from eskin_sensor_node.firmware.schedule import Frame, Schedule


SAMPLES = "samples"
PEAKS = "peaks"
ADAPTIVE = "adaptive"
"""Modes: every sample is sent; none, only peaks; or those that may lie away from the rest."""
HEARTBEAT = 40
"""Stretches of which an adaptive channel sends one at least."""
PACE = 1.0 / 64
"""Share of the way to a frame's mean that the baseline goes with each frame."""


class Smoothing:
    """Exponential smoothing of a tube: ``y_k = w·y_(k-1) + (1 - w)·x_k``, from the first sample on.

    The bounds enclose the smoothed truth, not the truth: peaks are sought in them, blocks never
    hold them. A sample with an unbounded side starts it anew.

    Args:
        weight: Weight w of the past, ``0 <= w < 1``.

    Attributes:
        lo: Lower bound of the past.
        hi: Upper bound of the past.
        fresh: Whether there is no past.
    """

    __slots__ = ("fresh", "hi", "lo", "weight")

    def __init__(self, weight: float) -> None:
        self.weight = weight
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self.lo = self.hi = 0.0
        self.fresh = True

    def smooth(self, lows: "Buffer", highs: "Buffer", n: int) -> None:
        """Replace n bounds by smoothed ones."""
        past, present = self.weight, 1.0 - self.weight
        for k in range(n):
            lo, hi = lows[k], highs[k]
            if lo == -INFINITY or hi == INFINITY:
                self.fresh = True
                continue
            if not self.fresh:
                lo = down(lo * (down(present) if lo >= 0.0 else up(present)))
                hi = up(hi * (up(present) if hi >= 0.0 else down(present)))
                lo, hi = down(down(past * self.lo) + lo), up(up(past * self.hi) + hi)
            self.lo, self.hi, self.fresh = lo, hi, False
            lows[k], highs[k] = lo, hi


class Baseline:
    """Bounds of a channel's mean while nothing touches: calibrated, then followed as it drifts.

    Drift compensation must not learn a touch that stays (icub-main#55 did). So the baseline follows
    only frames which *certainly* stay near it: a sustained contact is possibly or certainly away,
    is never followed, and never fades.

    Attributes:
        lo: Lower bound, in the channel's unit.
        hi: Upper bound.
        known: Whether it was ever calibrated.
    """

    __slots__ = ("hi", "known", "lo")

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Go back to before the first calibration."""
        self.lo = self.hi = 0.0
        self.known = False

    def calibrate(self, lows: "Sequence[float]", highs: "Sequence[float]", n: int) -> bool:
        """Take n samples as the rest; refused where a side of one is unbounded."""
        lo, hi = mean_bounds(lows, highs, n)
        self.known = hi - lo < INFINITY
        if self.known:
            self.lo, self.hi = lo, hi
        return self.known

    def scale(self, ratio: "tuple[float, float]") -> None:
        """Take what is measured from now on as greater by a positive ratio."""
        lo, hi = self.lo, self.hi
        self.lo = down(lo * (ratio[0] if lo >= 0.0 else ratio[1]))
        self.hi = up(hi * (ratio[1] if hi >= 0.0 else ratio[0]))

    def track(
        self, lows: "Sequence[float]", highs: "Sequence[float]", n: int, threshold: float
    ) -> bool:
        """Whether n samples are certainly nearer to the rest than a threshold; then follow them."""
        if not self.known:
            return False
        least, most = self.hi - threshold, self.lo + threshold
        for k in range(n):
            if lows[k] < least or highs[k] > most:
                return False
        lo, hi = mean_bounds(lows, highs, n)
        self.lo += PACE * (lo - self.lo)
        self.hi += PACE * (hi - self.hi)
        return True


def mean_bounds(lows: "Sequence[float]", highs: "Sequence[float]", n: int) -> "tuple[float, float]":
    """An enclosure of the mean of n samples."""
    lo = hi = 0.0
    for k in range(n):
        lo, hi = down(lo + lows[k]), up(hi + highs[k])
    return down(lo / n), up(hi / n)


class ChannelUnit:
    """Measures one channel.

    Attributes:
        baseline: Its rest.
        calibrating: Whether the next frame that is bounded becomes its rest.
        detector: Its search for peaks; ``None`` where there are none.
        first: Number of its next sample.
        since: Number of the first sample that smoothing may remember.
        silent: Frames since an adaptive channel sent one.
        smoothing: What smooths the samples in which peaks are sought.
        filled: Samples of its last frame, which stand in its buffers.
        away: Whether its last frame was possibly farther from its rest than a touch.

    Args:
        name: ``{taxel}.{quantity}``.
        coverage: Probability that a sample's interval encloses the truth.
        schedule: When it samples.
        threshold: Least prominence of its peaks, and how far from its rest a touch lies; 0 where it
            has no peaks.
        longest: ns after which undecided peaks are reported.
        clock: What the node knows of time.
        patch: What its samples are a column of.
        column: Which one.
        assembler: Takes its samples and peaks.
    """

    def __init__(
        self,
        name: str,
        coverage: float,
        *,
        schedule: "Schedule",
        threshold: float,
        longest: int,
        clock: "Clock",
        patch: "Patch",
        column: int,
        assembler: "Assembler",
    ) -> None:
        self.name = name
        self._coverage = coverage
        self.baseline = Baseline()
        self.lows = array("d", bytes(8 * schedule.capacity))
        self.highs = array("d", bytes(8 * schedule.capacity))
        self._longest = longest
        self._clock = clock
        self.patch = patch
        self.column = column
        self._assembler = assembler
        self.silent = 0
        self.calibrating = False
        self.maybe_touched = False
        self.filled = 0
        self._schedule = schedule
        self.first = self.since = 0
        self.restart(schedule, threshold, 0.0)

    def restart(self, schedule: "Schedule", threshold: float, smoothing: float) -> None:
        """Seek anew, with other settings; another schedule counts its samples anew."""
        if schedule is not self._schedule:
            self._schedule, self.first = schedule, 0
        self.threshold = threshold
        self.smoothing, self.since = Smoothing(smoothing), self.first
        longest = max(2, self._longest // schedule.dt)
        self.detector = PeakDetector(threshold, longest, self.first) if threshold > 0.0 else None

    def calibrate(self) -> None:
        """Take the next frame that is bounded as the rest."""
        self.calibrating = True

    def report(self, frame: "Frame", mode: str) -> bool:
        """Hand on the frame in the buffers, then its peaks; gives whether its samples are sent."""
        if self.calibrating:
            self.calibrating = not self.baseline.calibrate(self.lows, self.highs, frame.n)
        self.filled, self.first = frame.n, frame.first + frame.n
        at_rest = self.baseline.track(self.lows, self.highs, frame.n, self.threshold)
        self.maybe_touched = self.baseline.known and self.threshold > 0.0 and not at_rest
        sent = mode == SAMPLES or (mode == ADAPTIVE and self._is_due(at_rest=at_rest))
        bounds = (self.lows, self.highs) if sent else None
        self._assembler.add(self.patch, self.column, frame, self._coverage, bounds)
        if self.detector is not None:
            if self.smoothing.weight > 0.0:
                self.smoothing.smooth(self.lows, self.highs, frame.n)
            self._state_peaks(self.detector.feed(self.lows, self.highs, frame.n))
            if frame.closes:
                self._state_peaks(self.detector.gap(0))
        return sent

    def omit(self, frame: "Frame") -> None:
        """Skip a frame that was sampled, and is not sent because the taxel is broken."""
        self.skip(frame.n)
        self._assembler.add(self.patch, self.column, frame, self._coverage, None)

    def skip(self, samples: int) -> None:
        """Skip missing samples; hands on the peaks that stay undecided."""
        self.filled = 0 if samples else self.filled
        self.first += samples
        if self.detector is not None:
            self._state_peaks(self.detector.gap(samples))
        self.smoothing.reset()
        self.since = self.first

    def _is_due(self, *, at_rest: bool) -> bool:
        self.silent = self.silent + 1 if at_rest and self.silent + 1 < HEARTBEAT else 0
        return self.silent == 0

    def _state_peaks(self, events: "list[PeakEvent]") -> None:
        for event in events:
            earliest, _ = self._clock.enclosure(self._schedule.ticks(event.first))
            _, latest = self._clock.enclosure(self._schedule.ticks(event.last))
            # A smoothed sample holds only if all of those that it remembers do.
            first = self.since if self.smoothing.weight > 0.0 else event.first
            coverage = union_coverage(self._coverage, event.last - first + 1)
            time = earliest, latest
            self._assembler.state_peak(self.patch, self.column, event, time, coverage)


def union_coverage(coverage: float, samples: int) -> float:
    """Probability that all samples hold at once, at least (union bound, rounded down)."""
    if coverage == 1.0:
        return 1.0
    # 1 - coverage is exact (Sterbenz) for any coverage from one half on.
    beyond = up(samples * (1.0 - coverage))
    return max(0.0, down(1.0 - beyond))
