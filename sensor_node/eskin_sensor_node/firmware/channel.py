"""One quantity of one taxel: samples, baseline, peaks and their messages."""

from array import array

from eskin_sensor_node.firmware.baseline import Baseline
from eskin_sensor_node.firmware.peaks import PeakDetector
from eskin_sensor_node.firmware.rounding import down, up
from eskin_sensor_node.firmware.smoothing import Smoothing

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.clock import Clock
    from eskin_sensor_node.firmware.message_writer import Channel, MessageWriter, Record
    from eskin_sensor_node.firmware.peaks import PeakEvent
    from eskin_sensor_node.firmware.schedule import Frame, Schedule

SAMPLES = "samples"
PEAKS = "peaks"
ADAPTIVE = "adaptive"
"""Modes: every sample is sent; none, only peaks; or those that may lie away from the rest."""
HEARTBEAT = 40
"""Frames of which an adaptive channel sends one at least."""


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
        channel: Its name, unit, period and coverage.
        schedule: When it samples.
        threshold: Least prominence of its peaks, and how far from its rest a touch lies; 0 where it
            has no peaks.
        longest: ns after which undecided peaks are reported.
        clock: What the node knows of time.
        message_writer: Writes its messages.
    """

    def __init__(
        self,
        channel: "Channel",
        *,
        schedule: "Schedule",
        threshold: float,
        longest: int,
        clock: "Clock",
        message_writer: "MessageWriter",
    ) -> None:
        self.channel = channel
        self.baseline = Baseline()
        self.lows = array("d", bytes(8 * schedule.block))
        self.highs = array("d", bytes(8 * schedule.block))
        self._longest = longest
        self._clock = clock
        self._message_writer = message_writer
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
        self.channel.dt = schedule.dt
        longest = max(2, self._longest // schedule.dt)
        self.detector = PeakDetector(threshold, longest, self.first) if threshold > 0.0 else None

    def calibrate(self) -> None:
        """Take the next frame that is bounded as the rest."""
        self.calibrating = True

    def report(self, frame: "Frame", mode: str, encoding: int) -> "list[Record]":
        """Messages of the frame in the buffers: its block, then its peaks."""
        if self.calibrating:
            self.calibrating = not self.baseline.calibrate(self.lows, self.highs, frame.n)
        self.filled, self.first = frame.n, frame.first + frame.n
        at_rest = self.baseline.track(self.lows, self.highs, frame.n, self.threshold)
        self.maybe_touched = self.baseline.known and self.threshold > 0.0 and not at_rest
        records = []
        if mode == SAMPLES or (mode == ADAPTIVE and self._is_block_due(at_rest=at_rest)):
            time = self._clock.enclosure(frame.start, frame.n * frame.dt)
            records.append(
                self._message_writer.block(
                    self.channel, frame.start, time, encoding, self.lows, self.highs, frame.n
                )
            )
        if self.detector is not None:
            if self.smoothing.weight > 0.0:
                self.smoothing.smooth(self.lows, self.highs, frame.n)
            self._append_peaks(records, self.detector.feed(self.lows, self.highs, frame.n))
            if frame.closes:
                self._append_peaks(records, self.detector.gap(0))
        return records

    def skip(self, samples: int) -> "list[Record]":
        """Skip missing samples; gives the peaks that stay undecided."""
        records: list[Record] = []
        self.filled = 0 if samples else self.filled
        self.first += samples
        if self.detector is not None:
            self._append_peaks(records, self.detector.gap(samples))
        self.smoothing.reset()
        self.since = self.first
        return records

    def _is_block_due(self, *, at_rest: bool) -> bool:
        self.silent = self.silent + 1 if at_rest and self.silent + 1 < HEARTBEAT else 0
        return self.silent == 0

    def _append_peaks(self, records: "list[Record]", events: "list[PeakEvent]") -> None:
        for event in events:
            earliest, _ = self._clock.enclosure(self._schedule.ticks(event.first))
            _, latest = self._clock.enclosure(self._schedule.ticks(event.last))
            # A smoothed sample holds only if all of those that it remembers do.
            first = self.since if self.smoothing.weight > 0.0 else event.first
            coverage = union_coverage(self.channel.coverage, event.last - first + 1)
            records.append(
                self._message_writer.peak(self.channel, event, (earliest, latest), coverage)
            )


def union_coverage(coverage: float, samples: int) -> float:
    """Probability that all samples hold at once, at least (union bound, rounded down)."""
    if coverage == 1.0:
        return 1.0
    # 1 - coverage is exact (Sterbenz) for any coverage from one half on.
    beyond = up(samples * (1.0 - coverage))
    return max(0.0, down(1.0 - beyond))
