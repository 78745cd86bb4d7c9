"""One emulated taxel: signal chain, ADC and control unit."""

from __future__ import annotations

from array import array
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eskin.errors import FirmwareError
from eskin_sensor_node.firmware.autoranging import Readings
from eskin_sensor_node.firmware.control_unit import ControlUnit
from eskin_sensor_node.firmware.gap_reasons import UNRECORDED
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.machine.prices import Cycles, inversion, passes
from eskin_sensor_node.machine.schedule import build_schedule
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from types import ModuleType

    from eskin.interval import Floats
    from eskin_sensor_node.columns.sensing import Sensed, SensingColumns
    from eskin_sensor_node.firmware.adaptation import Adaptation
    from eskin_sensor_node.firmware.assembler import Assembler
    from eskin_sensor_node.firmware.channel import ChannelUnit
    from eskin_sensor_node.firmware.message_writer import MessageWriter, Record
    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.firmware.selftest import SelfTest
    from eskin_sensor_node.firmware.taxel.taxel import Taxel
    from eskin_sensor_node.kinds.converter import Codes
    from eskin_sensor_node.kinds.frontend import Digitised, Frontend
    from eskin_sensor_node.kinds.settings import Companion, TaxelSection
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.machine.node_layout import Column
    from eskin_sensor_node.settings import SamplingSection


class TruePart(NamedTuple):
    """The truth behind the samples of one column of a patch.

    Attributes:
        patch: Number of the patch.
        column: Which column.
        start: Ticks of the first sample.
        dt: Sampling period, ns.
        values: True values in the channel's unit, without noise.
    """

    patch: int
    column: int
    start: int
    dt: int
    values: Floats


class Repeats(NamedTuple):
    """Samples that were converted again.

    Attributes:
        samples: How many.
        conversions: How often in all.
    """

    samples: int = 0
    conversions: int = 0


class SampleHold:
    """The held samples of one input, of one frame, to convert again with another range.

    Args:
        values: What is held before the amplifiers, columns × samples.
        column: The taxel's.
        frontend: Converts them.

    Attributes:
        conversions: How often something was converted again.
    """

    def __init__(self, values: Floats, column: int, frontend: Frontend) -> None:
        self._values = values
        self._column = column
        self._frontend = frontend
        self._known: dict[tuple[float, int], Codes] = {}
        self.conversions = 0

    def sample(self, k: int) -> Callable[[float, int], int]:
        """Converts the k-th sample again, with a gain and a step of the trimmer."""

        def convert(gain: float, trim: int) -> int:
            self.conversions += 1
            if (gain, trim) not in self._known:
                codes = self._frontend.repeat(self._values, gain, trim)
                self._known[gain, trim] = codes[self._column]
            return int(self._known[gain, trim][k])

        return convert


class InputReader:
    """Reads the inputs of one taxel.

    Args:
        unit: Its control unit.
        group: What is before it.
        column: Its column there.
        last: Greatest code of its converter.
        inputs: Names of the inputs, in their order.

    Attributes:
        repeats: What was converted again since it began.
    """

    def __init__(
        self,
        unit: ControlUnit,
        group: TaxelGroup,
        column: int,
        *,
        last: int,
        inputs: Sequence[str],
    ) -> None:
        self._unit = unit
        self._group = group
        self._column = column
        self._last = last
        self._inputs = inputs
        self.begin()

    def begin(self) -> None:
        """Reset the count."""
        self.repeats = Repeats()

    def read(self, digitised: Digitised) -> Readings:
        """The codes of each input, after the firmware has repeated what it wanted."""
        column = self._column
        codes = [array("q", digitised.codes[name][column].tobytes()) for name in self._inputs]
        if not self._unit.adaptive:
            return Readings(codes, ())
        amplified = [name for name in self._inputs if name in digitised.held]
        readings = Readings(codes, [array("b", bytes(len(codes[0]))) for _ in amplified])
        for i, name in enumerate(amplified):
            frontend = self._group.sensing.frontend
            self._repeat(readings, i, SampleHold(digitised.held[name], column, frontend))
        return readings

    def _repeat(self, readings: Readings, i: int, held: SampleHold) -> None:
        codes = np.asarray(readings.codes[i])
        for k in np.flatnonzero((codes <= 0) | (codes >= self._last)).tolist():
            self._unit.repeat(readings, i, k, held.sample(k))
        samples = sum(mark != 0 for mark in readings.ranges[i])
        self.repeats = Repeats(
            self.repeats.samples + samples, self.repeats.conversions + held.conversions
        )


class TaxelGroup:
    """Taxels of a node that have one data sheet, sampled in columns; it outlives each reset.

    Args:
        sensing: Worlds, chains and actuators.
        clock: The node's clock.
    """

    def __init__(self, sensing: SensingColumns, clock: Clock) -> None:
        self.sensing = sensing
        self._clock = clock
        self._gains = np.ones((len(sensing), 1))
        self._trims, self._plates = np.zeros((2, len(sensing), 1), np.int64)
        self._latest: tuple[tuple[int, ...], Sensed] | None = None

    def adjust(self, column: int, chosen: Adaptation) -> None:
        """Set amplifier, trimmer and plates of a taxel as its control unit has chosen."""
        settings = (
            (self._gains, chosen.gain), (self._trims, chosen.trim), (self._plates, chosen.plate),
        )  # fmt: skip
        if all(values[column, 0] == value for values, value in settings):
            return
        for values, value in settings:
            values[column] = value
        self.sensing.frontend.adjust(self._gains, self._trims)
        self.sensing.world.move(self._plates)
        self._latest = None

    def sense(self, boot: int, frame: Frame, *, triggered: bool) -> Sensed:
        """Sample all taxels at a frame's instants; those of one frame are sampled once.

        Args:
            boot: The node's.
            frame: One taxel's.
            triggered: Whether its times count from the trigger of its burst.
        """
        key = boot, frame.start, frame.dt, frame.n
        if self._latest is None or self._latest[0] != key:
            instants = frame.start + frame.dt * np.arange(frame.n, dtype=np.int64)
            seconds = self._clock.seconds(frame, triggered=triggered)
            self._latest = key, self.sensing.sense(boot, instants, seconds[None])
        return self._latest[1]


class EmulatedTaxel:
    """Samples one taxel, frame by frame.

    Args:
        taxel: Its settings.
        group: Where it is sampled.
        column: Its column there.
        clock: The node's clock.
        sampling: The node's stretches.
        columns: Of each quantity, where its samples stand in frames.
        most: Samples of a channel in one frame, at most.
        functions: The firmware's arithmetic, or its compiled copy.
        repeats: How often a sample can be converted again before the next one comes.
        companions: What it reads along, by the names of its inputs.
        coverage: Probability that its intervals hold the truth.
    """

    def __init__(  # noqa: PLR0913 - parts of one design
        self,
        taxel: TaxelSection,
        *,
        companions: Mapping[str, Companion],
        coverage: float,
        group: TaxelGroup,
        column: int,
        clock: Clock,
        sampling: SamplingSection,
        columns: Sequence[Column],
        most: int,
        functions: ModuleType,
        repeats: int,
    ) -> None:
        self._taxel = taxel
        self._inverted: list[int] = []
        self._sampling, self._columns, self._most = sampling, columns, most
        self._repeats = repeats
        self._functions = functions
        self.group = group
        self._column = column
        self._companions = companions
        self._coverage = coverage
        self._clock = clock

    def boot(self, number: int, message_writer: MessageWriter, assembler: Assembler) -> None:
        """Start its control unit with an empty RAM.

        Args:
            number: The boot's. It draws the noise: each frame's depends on its start alone.
            message_writer: Writes the node's messages.
            assembler: Takes samples and peaks.
        """
        taxel = self._taxel
        self._boot = number
        self._message_writer = message_writer
        self._calibrated = taxel.firmware(data_sheet(taxel, self._companions), self._functions)
        self.control_unit = ControlUnit(
            taxel.id,
            self._calibrated,
            schedule=build_schedule(taxel, self._sampling, self._most),
            coverage=self._coverage,
            prominences=taxel.prominences,
            longest=round(taxel.longest_region_s * BILLION),
            columns=self._columns,
            repeats=self._repeats,
            clock=self._clock.known,
            assembler=assembler,
        )
        self.reader = InputReader(
            self.control_unit,
            self.group,
            self._column,
            last=(1 << taxel.adc_bits) - 1,
            inputs=self._calibrated.inputs,
        )
        self._inverted = list(self._calibrated.inverted)
        self.next: Frame = self.control_unit.schedule.frame(0)
        self._adjust()

    @property
    def name(self) -> str:
        """The taxel's."""
        return self.control_unit.name

    @property
    def units(self) -> Mapping[str, str]:
        """UCUM code of each quantity that it states."""
        return self._taxel.units

    @property
    def around(self) -> list[str]:
        """Names of its neighbours in the skin that the node has."""
        return [unit.name for unit in self.control_unit.around]

    @property
    def adjustment(self) -> tuple[float, int, int]:
        """Gain, step of the trimmer, plates."""
        chosen = self.control_unit.adaptation
        return chosen.gain, chosen.trim, chosen.plate

    @property
    def period(self) -> int:
        """From sample to sample, ns."""
        return self.control_unit.schedule.dt

    @property
    def broken(self) -> bool:
        """Whether it is certainly broken."""
        return self.control_unit.broken

    @property
    def inputs(self) -> int:
        """Of the converter, each of them read at each sample."""
        return len(self._calibrated.inputs)

    def cycles(self, n: int) -> Cycles:
        """What the n samples of its latest frame take: inversion, and each channel's passes."""
        before, self._inverted = self._inverted, list(self._calibrated.inverted)
        counts = [now - then for then, now in zip(before, self._inverted, strict=True)]
        new = dict(zip(self.along, counts, strict=True))
        measured = n + self.reader.repeats.samples
        unit = self.control_unit
        total = inversion(self._taxel.chain, measured, unit.known_neighbours, new)
        for each in unit.units:
            sought, smoothed = each.detector is not None, each.smoothing.weight > 0.0
            total = total.plus(
                passes(rest=each.baseline.known, peaks=sought, smoothed=sought and smoothed).times(
                    n
                )
            )
        return total

    @property
    def calibrated(self) -> Taxel:
        """Its calibration, as it is adjusted at present."""
        return self._calibrated

    @property
    def coverage(self) -> float:
        """Probability that its intervals hold the truth."""
        return self._coverage

    @property
    def chain(self) -> str:
        """Whose price its inversion has."""
        return self._taxel.chain

    @property
    def reads_intervals(self) -> bool:
        """Whether its world is a recording, known as intervals and not at each instant."""
        return self._taxel.kind.startswith("recorded")

    @property
    def along(self) -> list[str]:
        """Chains of the sensors that it reads along."""
        return [each.taxel.chain for each in self._companions.values()]

    def converted(self, frame: Frame, k: int) -> list[list[int]]:
        """What its converter gives for one sample of a frame, which the firmware has to come.

        Returns:
            Codes of its inputs; twice where the world is known as intervals, none where it is not
            known.
        """
        triggered = self.control_unit.schedule.burst > 0
        sensed = self.group.sense(self._boot, frame, triggered=triggered)
        if sensed.missing is not None and sensed.missing[k]:
            return []
        return [
            [int(each.codes[name][self._column][k]) for name in self._calibrated.inputs]
            for each in sensed.readings
        ]

    def sample(self) -> tuple[list[Record], list[TruePart]]:
        """Sample the next frame; gives gaps, and the truth behind the samples that are sent.

        Raises:
            FirmwareError: The firmware failed.
        """
        frame = self.next
        sensed = self._sense(frame)
        gaps: list[Record] = []
        truth: list[TruePart] = []
        for begin, end, present in sensed.runs(frame.n):
            part = frame.part(begin, end)
            if present:
                self._truth = self._own_truth(sensed, begin, end)
                digitised = [each.part(begin, end) for each in sensed.readings]
                with self._firmware_errors():
                    readings = [self.reader.read(each) for each in digitised]
                    sent = self.control_unit.process(part, *readings)
                truth += self._true_parts(part, sent)
            else:
                gaps.append(self._record_gap(part))
        self._advance()
        return gaps, truth

    def measure(self) -> None:
        """Measure the next frame, which has no gaps, without messages.

        Raises:
            FirmwareError: The firmware failed.
        """
        sensed = self._sense(self.next)
        self._truth = self._own_truth(sensed, 0, self.next.n)
        with self._firmware_errors():
            self.control_unit.measure(self.next, self.reader.read(sensed.readings[0]))

    def separate(self) -> None:
        """Subtract the crosstalk of measured neighbours.

        Raises:
            FirmwareError: The firmware failed.
        """
        with self._firmware_errors():
            self.control_unit.separate()

    def report(self) -> list[TruePart]:
        """Hand on the frame that was measured; gives the truth behind the samples that are sent.

        Raises:
            FirmwareError: The firmware failed.
        """
        frame = self.next
        with self._firmware_errors():
            sent = self.control_unit.report()
        self._advance()
        return self._true_parts(frame, sent)

    def _sense(self, frame: Frame) -> Sensed:
        self.reader.begin()
        triggered = self.control_unit.schedule.burst > 0
        return self.group.sense(self._boot, frame, triggered=triggered)

    def _own_truth(self, sensed: Sensed, begin: int, end: int) -> dict[str, Floats]:
        return {name: values[self._column, begin:end] for name, values in sensed.truth.items()}

    @contextmanager
    def _firmware_errors(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            raise FirmwareError(f"{self.name}: {type(error).__name__}: {error}") from error

    def _true_parts(self, frame: Frame, sent: Sequence[ChannelUnit]) -> list[TruePart]:
        """The truth behind what is sent; the hardware is set for the next frame."""
        self._adjust()
        return [
            TruePart(
                unit.patch.number,
                unit.column,
                frame.start,
                frame.dt,
                self._truth[unit.name.rpartition(".")[2]],
            )
            for unit in sent
        ]

    def _record_gap(self, frame: Frame) -> Record:
        """Record a gap: there was nothing to sample."""
        known = self._clock.known
        time = known.enclosure(frame.start)[0], known.enclosure(frame.end)[1]
        self.control_unit.skip(frame.n)
        patches = sorted({unit.patch.number for unit in self.control_unit.units})
        samples = frame.n * len(self.control_unit.units)
        return self._message_writer.gap(UNRECORDED, time, samples, patches=patches)

    def feed(self, number: int, test: SelfTest) -> None:
        """Feed the self-test with the last frame of the first quantity."""
        unit = self.control_unit.units[0]
        test.take(number, unit.lows, unit.highs, unit.filled)

    def amplify(self, gain: float) -> None:
        """Set the amplifier before the converter."""
        self.control_unit.amplify(gain)
        self._adjust()

    def adapt(self, *, on: bool) -> None:
        """Turn adaptive gain, trimmer and plates on, or reset them to the design."""
        self.control_unit.adapt(int(on))
        self._adjust()

    def sample_every(self, dt: int) -> None:
        """Sample with another period, ns, from the next frame on."""
        self.control_unit.sample_every(dt, self.next.start)
        self.next = self.control_unit.schedule.frame(0)

    def reset(self) -> None:
        """Reset to the design."""
        self.control_unit.reset(self.next.start)
        self._adjust()
        self.next = self.control_unit.schedule.frame(0)

    def skip(self, ticks: int) -> int:
        """Skip all frames that begin before an instant; gives lost samples over all channels."""
        lost = 0
        while self.next.start < ticks:
            lost += self.next.n
            self._advance()
        self.control_unit.skip(lost)
        return lost * len(self.control_unit.units)

    def missing(self, ticks: int) -> int:
        """Samples that were due before an instant and not reported, over all channels."""
        due = self.control_unit.schedule.before(ticks)
        omitted_samples = self.control_unit.omitted_samples
        return max(0, due - self.next.first) * len(self.control_unit.units) + omitted_samples

    def finish(self) -> None:
        """Hand on the peaks that stay undecided at the end."""
        self.control_unit.skip(0)

    def _advance(self) -> None:
        self.next = self.control_unit.schedule.following(self.next)

    def _adjust(self) -> None:
        """Set the hardware as the control unit has chosen, for the next frame."""
        self.group.adjust(self._column, self.control_unit.adaptation)
