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
from eskin_sensor_node.kinds.registry import build_frontend, build_world
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.machine.prices import Cycles, inversion, passes
from eskin_sensor_node.machine.schedule import build_schedule
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from types import ModuleType

    from eskin.interval import Floats
    from eskin_sensor_node.firmware.adaptation import Adaptation
    from eskin_sensor_node.firmware.assembler import Assembler
    from eskin_sensor_node.firmware.channel import ChannelUnit
    from eskin_sensor_node.firmware.message_writer import MessageWriter, Record
    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.firmware.selftest import SelfTest
    from eskin_sensor_node.kinds.converter import Codes
    from eskin_sensor_node.kinds.frontend import Digitised
    from eskin_sensor_node.kinds.settings import Companion, TaxelSection
    from eskin_sensor_node.kinds.signals import Signals
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
        values: What is held before the amplifier.
        signal_chain: Converts it.

    Attributes:
        conversions: How often something was converted again.
    """

    def __init__(self, values: Floats, signal_chain: SignalChain) -> None:
        self._values = values
        self._signal_chain = signal_chain
        self._known: dict[tuple[float, int], Codes] = {}
        self.conversions = 0

    def sample(self, k: int) -> Callable[[float, int], int]:
        """Converts the k-th sample again, with a gain and a step of the trimmer."""

        def convert(gain: float, trim: int) -> int:
            self.conversions += 1
            if (gain, trim) not in self._known:
                self._known[gain, trim] = self._signal_chain.frontend.repeat(
                    self._values, gain, trim
                )
            return int(self._known[gain, trim][k])

        return convert


class Reader:
    """Reads the inputs of one taxel.

    Args:
        unit: Its control unit.
        signal_chain: What is before it.
        inputs: Names of the inputs, in their order.

    Attributes:
        repeats: What was converted again since it began.
    """

    def __init__(self, unit: ControlUnit, signal_chain: SignalChain, inputs: Sequence[str]) -> None:
        self._unit = unit
        self._signal_chain = signal_chain
        self._inputs = inputs
        self.begin()

    def begin(self) -> None:
        """Reset the count."""
        self.repeats = Repeats()

    def read(self, digitised: Digitised) -> Readings:
        """The codes of each input, after the firmware has repeated what it wanted."""
        codes = [array("q", digitised.codes[name].tobytes()) for name in self._inputs]
        if not self._unit.adaptive:
            return Readings(codes, ())
        amplified = [name for name in self._inputs if name in digitised.held]
        readings = Readings(codes, [array("b", bytes(len(codes[0]))) for _ in amplified])
        for i, name in enumerate(amplified):
            self._repeat(readings, i, SampleHold(digitised.held[name], self._signal_chain))
        return readings

    def _repeat(self, readings: Readings, i: int, held: SampleHold) -> None:
        codes = np.asarray(readings.codes[i])
        for k in np.flatnonzero((codes <= 0) | (codes >= self._signal_chain.last)).tolist():
            self._unit.repeat(readings, i, k, held.sample(k))
        samples = sum(mark != 0 for mark in readings.ranges[i])
        self.repeats = Repeats(
            self.repeats.samples + samples, self.repeats.conversions + held.conversions
        )


class SignalChain:
    """World, analogue front end and actuator of one taxel; they stay the same through each reset.

    Args:
        taxel: Its settings.
        seed: Draws them.
        companions: What it reads along, by the names of its inputs.

    Attributes:
        world: Gives the true signals at instants since the start (a burst: since its trigger).
        frontend: Turns signals into codes.
        last: Greatest code of its converter.
    """

    def __init__(
        self, taxel: TaxelSection, seed: tuple[int, ...], companions: Mapping[str, Companion]
    ) -> None:
        parts = np.random.default_rng(seed)
        self.world = build_world(taxel, parts)
        self.frontend = build_frontend(taxel, parts, companions)
        self.last = (1 << taxel.adc_bits) - 1

    def adjust(self, chosen: Adaptation) -> None:
        """Set amplifier, trimmer and plates as the control unit has chosen."""
        self.frontend.adjust(chosen.gain, chosen.trim)
        self.world.move(chosen.plate)


class EmulatedTaxel:
    """Samples one taxel, frame by frame.

    Args:
        taxel: Its settings.
        seed: Draws the true parts, the same at each boot.
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
        seed: tuple[int, ...],
        clock: Clock,
        sampling: SamplingSection,
        columns: Sequence[Column],
        most: int,
        functions: ModuleType,
        repeats: int,
    ) -> None:
        self._taxel = taxel
        self._inverted: list[int] = []
        self._seed = seed
        self._sampling, self._columns, self._most = sampling, columns, most
        self._repeats = repeats
        self._functions = functions
        self.signal_chain = SignalChain(taxel, seed, companions)
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
        self.reader = Reader(self.control_unit, self.signal_chain, self._calibrated.inputs)
        self._inverted = list(self._calibrated.inverted)
        self.next: Frame = self.control_unit.schedule.frame(0)
        self._adjust()

    @property
    def name(self) -> str:
        """The taxel's."""
        return self.control_unit.name

    @property
    def inputs(self) -> int:
        """Of the converter, each of them read at each sample."""
        return len(self._calibrated.inputs)

    def cycles(self, n: int) -> Cycles:
        """What the n samples of its latest frame take: inversion, and each channel's passes."""
        before, self._inverted = self._inverted, list(self._calibrated.inverted)
        chains = [each.taxel.chain for each in self._companions.values()]
        counts = [now - then for then, now in zip(before, self._inverted, strict=True)]
        new = dict(zip(chains, counts, strict=True))
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

    def sample(self) -> tuple[list[Record], list[TruePart]]:
        """Sample the next frame; gives gaps, and the truth behind the samples that are sent.

        Raises:
            FirmwareError: The firmware failed.
        """
        frame = self.next
        signals, random = self._sense(frame)
        gaps: list[Record] = []
        truth: list[TruePart] = []
        for begin, end, present in signals.runs(frame.n):
            part = frame.part(begin, end)
            if present:
                truth += self._measure(part, signals.part(begin, end), random)
            else:
                gaps.append(self._record_gap(part))
        self._advance()
        return gaps, truth

    def measure(self) -> None:
        """Measure the next frame, which has no gaps, without messages.

        Raises:
            FirmwareError: The firmware failed.
        """
        signals, random = self._sense(self.next)
        digitised = self.signal_chain.frontend.digitise(signals.sensed, random)
        self._truth = signals.truth | digitised.truth
        with self._firmware_errors():
            self.control_unit.measure(self.next, self.reader.read(digitised))

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
        return self._true_parts(frame, sent, self._truth)

    def _sense(self, frame: Frame) -> tuple[Signals, np.random.Generator]:
        self.reader.begin()
        random = np.random.default_rng((*self._seed, self._boot, frame.start))
        seconds = self._clock.seconds(frame, triggered=self.control_unit.schedule.burst > 0)
        return self.signal_chain.world.signals(seconds, random), random

    def _measure(
        self, frame: Frame, signals: Signals, random: np.random.Generator
    ) -> list[TruePart]:
        digitised = self.signal_chain.frontend.digitise(signals.sensed, random)
        truth = signals.truth | digitised.truth
        ends = [self.signal_chain.frontend.digitise(end, random) for end in signals.ends]
        with self._firmware_errors():
            readings = [self.reader.read(each) for each in ends or [digitised]]
            sent = self.control_unit.process(frame, *readings)
        return self._true_parts(frame, sent, truth)

    @contextmanager
    def _firmware_errors(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            raise FirmwareError(f"{self.name}: {type(error).__name__}: {error}") from error

    def _true_parts(
        self, frame: Frame, sent: Sequence[ChannelUnit], truth: Mapping[str, Floats]
    ) -> list[TruePart]:
        """The truth behind what is sent; the hardware is set for the next frame."""
        self._adjust()
        return [
            TruePart(
                unit.patch.number,
                unit.column,
                frame.start,
                frame.dt,
                truth[unit.name.rpartition(".")[2]],
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
        """Skip all frames that begin before a moment; gives lost samples over all channels."""
        lost = 0
        while self.next.start < ticks:
            lost += self.next.n
            self._advance()
        self.control_unit.skip(lost)
        return lost * len(self.control_unit.units)

    def missing(self, ticks: int) -> int:
        """Samples that were due before a moment and not reported, over all channels."""
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
        self.signal_chain.adjust(self.control_unit.adaptation)
