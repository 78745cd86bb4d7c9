"""The control unit of Fig. 3: from codes to intervals and peaks."""

from array import array

from eskin_sensor_node.firmware.adaptation import Adaptation
from eskin_sensor_node.firmware.autoranging import Autoranging
from eskin_sensor_node.firmware.channel import ADAPTIVE, PEAKS, SAMPLES, ChannelUnit

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin_sensor_node.firmware.assembler import Assembler, Patch
    from eskin_sensor_node.firmware.autoranging import Hold, Readings
    from eskin_sensor_node.firmware.clock import Clock
    from eskin_sensor_node.firmware.inversion import Buffer, Codes
    from eskin_sensor_node.firmware.schedule import Frame, Schedule
    from eskin_sensor_node.firmware.taxel.taxel import Taxel


_MODES_BY_LOAD = (SAMPLES, ADAPTIVE, PEAKS)
"""Modes, each of which sends less than the one before."""


class ControlUnit:
    """Measures one taxel, as it is set.

    Args:
        name: The taxel's.
        taxel: Its calibration.
        schedule: When its samples are taken.
        coverage: Probability that the noise stays within the calibration's reach.
        prominences: Quantity to the least prominence of its peaks; others have none.
        longest: ns after which undecided peaks are reported.
        columns: Of each quantity, its patch, and its column there.
        repeats: How often a sample can be converted again before the next one comes.
        clock: What the node knows of time.
        assembler: Takes samples and peaks of its channels.

    Attributes:
        broken: Whether the taxel is certainly stuck or dead: it reports no derived quantity then.
        ranging: Converts again what saturates, while it is adaptive.
        omitted_samples: Samples left out for this reason, until the caller reports them.
        around: Those of its neighbours in the skin that the node has.
        known_neighbours: How many were measured at the instants of its last frame.
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
        columns: "Sequence[tuple[Patch, int]]",
        repeats: int,
        clock: "Clock",
        assembler: "Assembler",
    ) -> None:
        self.name = name
        self.mode = SAMPLES
        self.adaptation = Adaptation(taxel.sheet)
        self.adaptive = self._designed_adaptive = taxel.sheet["adaptive"] != 0.0
        self.shed = 0
        self.smoothing = 0.0
        self.schedule = self.designed = schedule
        self.known_neighbours = 0
        self.broken = False
        self.omitted_samples = 0
        self.around: Sequence[ControlUnit] = ()
        self._frame: Frame | None = None
        self._adjustable: list[Codes] = []
        self.ranging = Autoranging(taxel, self.adaptation, repeats)
        self._taxel = taxel
        self._prominences = prominences
        self.units: list[ChannelUnit] = []
        self._bounds = []
        for (quantity, _), (patch, column) in zip(taxel.quantities, columns):  # noqa: B905 - MicroPython's zip
            made = ChannelUnit(
                name + "." + quantity,
                coverage,
                schedule=schedule,
                threshold=prominences.get(quantity, 0.0),
                longest=longest,
                clock=clock,
                patch=patch,
                column=column,
                assembler=assembler,
            )
            self.units.append(made)
            self._bounds += [made.lows, made.highs]

    @property
    def effective_mode(self) -> str:
        """The mode that is set, or one that sends less while load is shed."""
        return _MODES_BY_LOAD[max(_MODES_BY_LOAD.index(self.mode), min(self.shed, 2))]

    def process(
        self, frame: "Frame", readings: "Readings", other: "Readings | None" = None
    ) -> "list[ChannelUnit]":
        """Measure one frame; gives the channels whose samples are sent.

        Taxels that are sampled at the same instants do its three steps together, one by one.
        """
        self.measure(frame, readings, other)
        self.separate()
        return self.report()

    def surround(self, around: "Sequence[ControlUnit]", neighbours: int) -> None:
        """Sit among so many neighbours in the skin, some of which are measured by the node."""
        self.around = around
        self._taxel.surround(neighbours)

    def repeat(self, readings: "Readings", i: int, k: int, hold: "Hold") -> None:
        """Convert a sample again whose code is at an end: the k-th of the i-th amplified input."""
        if self.adaptive:
            self.ranging.repeat(readings, i, k, hold)

    def measure(
        self, frame: "Frame", readings: "Readings", other: "Readings | None" = None
    ) -> None:
        """Calculate a frame's samples back, as if the taxel were alone.

        Where the input was an interval, there are readings of its one end and of its other one;
        what is reported encloses both.
        """
        self._frame = frame
        self.ranging.measure(readings, frame.n, self._bounds)
        self._adjustable = list(readings.codes[: self._taxel.amplified])
        if other is not None:
            self._enclose(other, frame.n)
            self._adjustable += other.codes[: self._taxel.amplified]

    def separate(self) -> None:
        """Subtract the crosstalk of neighbours that are measured at the same instants."""
        if self._frame is None:
            return
        around = [unit.felt() for unit in self.around if unit.measures(self._frame)]
        self.known_neighbours = len(around)
        self._taxel.separate(self._frame.n, self._bounds, around)

    def measures(self, frame: "Frame") -> bool:
        """Whether it has measured at a frame's instants, and is not broken."""
        return self._frame is not None and self._frame.meets(frame) and not self.broken

    def felt(self) -> "tuple[Buffer, Buffer]":
        """What it hands on a share of, at its frame's instants."""
        return self._taxel.felt(self._bounds)

    def report(self) -> "list[ChannelUnit]":
        """Hand on the frame that was measured; gives the channels whose samples are sent."""
        sent: list[ChannelUnit] = []
        frame, self._frame = self._frame, None
        if frame is None:
            return sent
        for unit, (quantity, _) in zip(self.units, self._taxel.quantities):  # noqa: B905 - MicroPython's zip
            if self.broken and quantity in self._taxel.derived:
                unit.omit(frame)
                self.omitted_samples += frame.n
            elif unit.report(frame, self.effective_mode):
                sent.append(unit)
        if self.adaptive:
            plate = self.adaptation.plate
            self.adaptation.adapt(self._adjustable, frame.n, rests=self._is_untouched())
            self._adjust(plate)
        return sent

    def skip(self, samples: int) -> None:
        """Skip missing samples; hands on the peaks that stay undecided."""
        for unit in self.units:
            unit.skip(samples)

    def calibrate(self) -> None:
        """Take the next frame as the rest of each channel."""
        for unit in self.units:
            unit.calibrate()

    def amplify(self, gain: float) -> None:
        """Calculate with another gain of the amplifier; hands on undecided peaks."""
        self.adaptation.amplify(gain)
        self._adjust(self.adaptation.plate)
        self._restart(self.smoothing)

    def adapt(self, on: int) -> None:
        """Let gain, trimmer and plates be set here, or go back to the designed ones."""
        self.adaptive = on != 0
        plate = self.adaptation.plate
        self.adaptation.reset()
        self._adjust(plate)

    def smooth(self, weight: float) -> None:
        """Seek peaks in smoothed samples; hands on undecided ones."""
        self._restart(weight)

    def set_threshold(self, k: int, threshold: float) -> None:
        """Seek other peaks on the k-th channel; hands on undecided ones."""
        self.units[k].skip(0)
        self.units[k].restart(self.schedule, threshold, self.smoothing)

    def sample_every(self, dt: int, ticks: int) -> None:
        """Sample with another period, ns, from an instant on; hands on undecided peaks."""
        self.schedule = self.designed.at_period(dt, ticks)
        self._restart(self.smoothing)

    def reset(self, ticks: int) -> None:
        """Go back to the design, from an instant on; hands on undecided peaks."""
        self.skip(0)
        self.mode = SAMPLES
        self.smoothing = 0.0
        self.adapt(self._designed_adaptive)
        self.schedule = self.designed.at_period(self.designed.dt, ticks)
        for unit, (quantity, _) in zip(self.units, self._taxel.quantities):  # noqa: B905 - MicroPython's zip
            unit.baseline.forget()
            unit.restart(self.schedule, self._prominences.get(quantity, 0.0), 0.0)

    def _enclose(self, readings: "Readings", n: int) -> None:
        """Widen what is measured, so that it encloses other readings."""
        found = [array("d", bytes(8 * n)) for _ in self._bounds]
        self.ranging.measure(readings, n, found)
        for j in range(0, len(found), 2):
            lows, highs = self._bounds[j], self._bounds[j + 1]
            for k in range(n):
                lows[k] = min(lows[k], found[j][k])
                highs[k] = max(highs[k], found[j + 1][k])

    def _is_untouched(self) -> bool:
        """Whether nothing touches, as far as is known."""
        return not any(unit.maybe_touched for unit in self.units)

    def _adjust(self, plate: int) -> None:
        """Calculate with the chosen settings; peaks end where plates move from another step."""
        settings = self.adaptation
        self._taxel.adjust(settings.gain, settings.trim)
        if settings.plate != plate:
            ratios = self._taxel.move(plate, settings.plate)
            for unit, (quantity, _) in zip(self.units, self._taxel.quantities):  # noqa: B905 - MicroPython's zip
                if quantity in ratios:
                    unit.skip(0)
                    unit.baseline.scale(ratios[quantity])

    def _restart(self, smoothing: float) -> None:
        self.skip(0)
        self.smoothing = smoothing
        for unit in self.units:
            unit.restart(self.schedule, unit.threshold, smoothing)
