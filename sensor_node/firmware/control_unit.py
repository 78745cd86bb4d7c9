"""The control unit of Fig. 3: from codes to intervals, peaks, and the messages that tell them."""

from array import array

from sensor_node.firmware.peaks import PeakDetector
from sensor_node.firmware.record import Channel
from sensor_node.firmware.rounding import down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sensor_node.firmware.clock import Clock
    from sensor_node.firmware.inversion import Codes
    from sensor_node.firmware.peaks import PeakEvent
    from sensor_node.firmware.record import Record, Scribe
    from sensor_node.firmware.schedule import Frame, Schedule
    from sensor_node.firmware.taxel import Taxel


class ControlUnit:
    """Measures one taxel.

    Args:
        name: The taxel's.
        taxel: Its calibration.
        schedule: When its samples are taken.
        coverage: Probability that the noise stays within the calibration's reach.
        prominences: Quantity to the least prominence of its peaks; others have none.
        longest: Samples after which undecided peaks are reported.
        encoding: How blocks write their bounds.
        clock: What the node knows of time.
        scribe: Writes its messages.
    """

    def __init__(
        self,
        name: str,
        taxel: "Taxel",
        *,
        schedule: "Schedule",
        coverage: float,
        prominences: "Mapping[str, float]",
        longest: int,
        encoding: int,
        clock: "Clock",
        scribe: "Scribe",
    ) -> None:
        self._taxel = taxel
        self._schedule = schedule
        self._encoding = encoding
        self._clock = clock
        self._scribe = scribe
        self.channels: list[Channel] = []
        self._detectors: list[PeakDetector | None] = []
        self._bounds: list[array[float]] = []
        for quantity, unit in taxel.quantities:
            self.channels.append(Channel(name + "." + quantity, unit, schedule.dt, coverage))
            least = prominences.get(quantity)
            self._detectors.append(None if least is None else PeakDetector(least, longest))
            for _ in (0, 1):
                self._bounds.append(array("d", bytes(8 * schedule.block)))

    def process(self, frame: "Frame", codes: "Sequence[Codes]") -> "list[Record]":
        """Measure one frame: a block for each quantity, then the peaks that are decided now."""
        self._taxel.measure(codes, frame.n, self._bounds)
        time = self._clock.enclosure(frame.start, frame.n * frame.dt)
        records = []
        for k in range(len(self.channels)):
            lows, highs = self._bounds[2 * k], self._bounds[2 * k + 1]
            records.append(
                self._scribe.block(
                    self.channels[k], frame.start, time, self._encoding, lows, highs, frame.n
                )
            )
        for k in range(len(self.channels)):
            detector = self._detectors[k]
            if detector is not None:
                lows, highs = self._bounds[2 * k], self._bounds[2 * k + 1]
                self._tell(records, k, detector.feed(lows, highs, frame.n))
                if frame.closes:
                    self._tell(records, k, detector.gap(0))
        return records

    def skip(self, samples: int) -> "list[Record]":
        """Say that samples are missing here; gives the peaks that stay undecided."""
        records: list[Record] = []
        for k in range(len(self.channels)):
            detector = self._detectors[k]
            if detector is not None:
                self._tell(records, k, detector.gap(samples))
        return records

    def _tell(self, records: "list[Record]", k: int, events: "list[PeakEvent]") -> None:
        channel = self.channels[k]
        for event in events:
            earliest, _ = self._clock.enclosure(self._schedule.ticks(event.first))
            _, latest = self._clock.enclosure(self._schedule.ticks(event.last))
            coverage = union_coverage(channel.coverage, event.last - event.first + 1)
            records.append(self._scribe.peak(channel, event, (earliest, latest), coverage))


def union_coverage(coverage: float, samples: int) -> float:
    """Probability that all samples hold at once, at least (union bound, rounded down)."""
    if coverage == 1.0:
        return 1.0
    # 1 - coverage is exact (Sterbenz) for any coverage from one half on.
    beyond = up(samples * (1.0 - coverage))
    return max(0.0, down(1.0 - beyond))
