"""Reflexes of an emulated node: samples one by one, and what they take of the machine."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol

from eskin.errors import MonitorError, SettingsError
from eskin.monitor.program import threshold
from eskin.union_bound import union_coverage
from eskin.wire.messages.command import KEY_PLACE, MONITOR_PLACE, NEVER
from eskin_sensor_node.firmware import monitor as engine
from eskin_sensor_node.firmware.expression import Comparison, Meter
from eskin_sensor_node.firmware.reflex import Reflex, ReflexUnit, code_ranges
from eskin_sensor_node.kinds.neighbours import measured_around
from eskin_sensor_node.machine.budget import ram_budget
from eskin_sensor_node.machine.ledger import CONVERSION_NS
from eskin_sensor_node.machine.monitor_program import MonitorProgram, difference
from eskin_sensor_node.machine.prices import BILLION, PROCESSORS, Cycles, inversion
from eskin_sensor_node.machine.processor import capacity, processor_load

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from eskin.monitor import Atom
    from eskin.monitor.program import Threshold
    from eskin.wire.messages.command import Arguments, State, Value
    from eskin_sensor_node.firmware.assembler import Assembler
    from eskin_sensor_node.firmware.clock import Clock
    from eskin_sensor_node.firmware.expression import Expression
    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.firmware.taxel.taxel import Taxel
    from eskin_sensor_node.machine.machine import Machine
    from eskin_sensor_node.machine.sampling import SamplingInterrupts
    from eskin_sensor_node.node.gesture_key import GestureKey
    from eskin_sensor_node.settings import NodeSettings

log = logging.getLogger(__name__)

NO_OUTPUT: Final = "none"
MOST_MONITORS: Final = 16
MOST_WORK_NS: Final = 1_000_000
"""ns of work from the last conversion of an instant to the outputs, at most."""
_METER: Final = 512
"""Bytes of a taxel that is measured at each sample: bounds, codes, and objects."""
VERDICTS: Final = {"possible": engine.POSSIBLE, "certain": engine.CERTAIN}


class MonitoredTaxel(Protocol):
    """A taxel whose samples monitors read one by one: emulated by itself, or a column of a skin."""

    @property
    def name(self) -> str:
        """The taxel's."""
        ...

    @property
    def units(self) -> Mapping[str, str]:
        """UCUM code of each quantity that it states."""
        ...

    @property
    def around(self) -> Sequence[str]:
        """Names of its neighbours in the skin that the node samples at the same instants."""
        ...

    @property
    def calibrated(self) -> Taxel:
        """Its calibration, as it is adjusted at present."""
        ...

    @property
    def adjustment(self) -> tuple[float, int, int]:
        """What its thresholds depend on: gain, step of the trimmer, plates."""
        ...

    @property
    def period(self) -> int:
        """From sample to sample, ns."""
        ...

    @property
    def next(self) -> Frame:
        """The samples of the stretch that is not complete."""
        ...

    @property
    def inputs(self) -> int:
        """Of the converter, each of them read at each sample."""
        ...

    @property
    def coverage(self) -> float:
        """Probability that its intervals hold the truth."""
        ...

    @property
    def chain(self) -> str:
        """Whose price its inversion has."""
        ...

    @property
    def broken(self) -> bool:
        """Whether it is certainly broken."""
        ...

    @property
    def reads_intervals(self) -> bool:
        """Whether its world is a recording, known as intervals and not at each instant."""
        ...

    def converted(self, frame: Frame, k: int) -> Sequence[Sequence[int]]:
        """Codes of its inputs at one sample of a frame; see `EmulatedTaxel.converted`."""
        ...

    @property
    def along(self) -> Sequence[str]:
        """Chains of the sensors that it reads along."""
        ...


class Definition(NamedTuple):
    """What a monitor is.

    Attributes:
        formula: Its text.
        on: The least verdict with which its output is on.
        output: What it drives; `NO_OUTPUT` for nothing.
    """

    formula: str
    on: str = "possible"
    output: str = NO_OUTPUT

    @classmethod
    def of(cls, settings: Mapping[str, Value]) -> Definition:
        """Of a command's arguments, or of a reported place.

        Raises:
            KeyError: A part is missing.
        """
        return cls(str(settings["formula"]), str(settings["on"]), str(settings["output"]))


class _Compiled(NamedTuple):
    """An atom that integer thresholds decide."""

    atom: engine.Threshold
    taxel: MonitoredTaxel
    quantity: int
    threshold: Threshold


class _Defined(NamedTuple):
    """A monitor that runs.

    Attributes:
        definition: What it is.
        program: What it runs.
        compiled: Atoms that depend on how taxels are adjusted.
        meters: Taxels that are measured at each sample, and those around them.
        taxels: Names of all that it reads.
    """

    definition: Definition
    program: MonitorProgram
    compiled: list[_Compiled]
    meters: list[Meter]
    taxels: list[str]


class NodeReflexes:
    """Runs a node's monitors at each sample of the taxels that they read.

    An interrupt after the last conversion of an instant has priority over all other work.

    Args:
        settings: The node's.
        taxels: Its taxels, booted, by their names.
        machine: What it runs on.
        sampling: Its sampling interrupts.
        clock: What it knows of time.
        assembler: Takes verdicts.
        gesture_key: Takes those of its gestures.

    Raises:
        SettingsError: A monitor of the settings cannot be used.
    """

    def __init__(
        self,
        settings: NodeSettings,
        taxels: Mapping[str, MonitoredTaxel],
        *,
        machine: Machine,
        sampling: SamplingInterrupts,
        clock: Clock,
        assembler: Assembler,
        gesture_key: GestureKey,
    ) -> None:
        self._settings = settings
        self._taxels = taxels
        self._units = {
            f"{name}.{quantity}": unit
            for name, taxel in taxels.items()
            for quantity, unit in taxel.units.items()
        }
        self._machine, self._sampling = machine, sampling
        self._prices = PROCESSORS[settings.machine.processor]
        self._key = gesture_key
        self._unit = ReflexUnit(clock, assembler, self._drive, gesture_key.lock)
        self._timer = machine.interrupt(self._decide)
        self._drift = round(settings.clock.drift_ppm * 1e3)
        self._sources: dict[str, engine.Source] = {}
        self._meters: dict[str, Meter] = {}
        self._adjusted: dict[str, tuple[tuple[float, int, int], int]] = {}
        self._defined: dict[str, _Defined] = {}
        self._due: list[tuple[MonitoredTaxel, Frame, int]] = []
        self._last = -1
        self._done = 0
        self.reset()

    @property
    def definitions(self) -> dict[str, Definition]:
        """All monitors."""
        return {name: each.definition for name, each in self._defined.items()}

    @property
    def state(self) -> State:
        """The places that report them, and those of the settings that a command removed."""
        removed = [each.name for each in self._settings.monitor if each.name not in self._defined]
        found: State = {
            MONITOR_PLACE + name: dict(each._asdict()) for name, each in self.definitions.items()
        }
        found |= {MONITOR_PLACE + name: {"on": NEVER} for name in removed}
        return found | ({KEY_PLACE: self._key.state} if self._key.gestures else {})

    def apply(self, arguments: Arguments) -> None:
        """Apply the command ``monitor``, whole or not at all.

        Args:
            arguments: As `eskin.wire.messages.command.check_arguments` allows.

        Raises:
            MonitorError: The monitor cannot be used, or there is none to remove.
        """
        name = str(arguments["monitor"])
        if name in self._key.gestures:
            raise MonitorError(f"{name} is a gesture of the key; the node's file defines it")
        if arguments["on"] == NEVER:
            self.remove(name)
        else:
            self.define(name, Definition.of(arguments))

    def restore(self, state: State) -> None:
        """Restore the last reported state at boot, leaving out what no longer fits."""
        self._key.restore(state.get(KEY_PLACE, {}), self._machine.now - self._machine.booted)
        for place, settings in state.items():
            name = place.removeprefix(MONITOR_PLACE)
            if name == place or name in self._key.gestures:
                continue
            if settings.get("on") == NEVER:
                if name in self._defined:
                    self.remove(name)
                continue
            try:
                self.define(name, Definition.of(settings))
            except (KeyError, MonitorError) as error:
                log.warning("monitor left out: name=%s reason=%s", name, error)

    def reset(self) -> None:
        """Go back to the monitors of the settings.

        Raises:
            SettingsError: One cannot be used.
        """
        for name in list(self._defined):
            self.remove(name)
        for each in self._settings.monitor:
            try:
                self.define(each.name, Definition(each.formula, each.on, each.output))
            except MonitorError as error:
                raise SettingsError(f"monitor.{each.name}", str(error)) from error

    def define(self, name: str, definition: Definition) -> None:
        """Run a monitor from the next sample on, in place of one of its name.

        Raises:
            MonitorError: It cannot be used, or the machine is too small or too slow for it.
        """
        program = MonitorProgram.compile(definition.formula, self._units)
        compiled: list[_Compiled] = []
        meters: dict[str, Meter] = {}
        atoms = [self._atom(each, compiled, meters) for each in program.atoms]
        names = [each.taxel.name for each in compiled] + list(meters)
        made = _Defined(
            definition, program, compiled, [*meters.values()], list(dict.fromkeys(names))
        )
        self._require_room({**self._defined, name: made})
        for each in compiled:
            self._calibrate(each)
        monitor = engine.Monitor(program.lines, atoms, program.reach, self._drift)
        output = "" if definition.output == NO_OUTPUT else definition.output
        self._unit.define(
            Reflex(
                name,
                monitor,
                VERDICTS[definition.on],
                output,
                self._coverage(made),
                made.meters,
                secret=name in self._key.gestures,
            )
        )
        if not self._defined:
            self.skip(self._machine.now - self._machine.booted)
        self._defined[name] = made
        self.arm()

    def remove(self, name: str) -> None:
        """Stop a monitor.

        Raises:
            MonitorError: There is none of this name.
        """
        if name not in self._defined:
            known = ", ".join(self._defined) or "none"
            raise MonitorError(f"there is no monitor {name}; there are: {known}", value=name)
        del self._defined[name]
        self._unit.remove(name)
        self.arm()

    def arm(self) -> None:
        """Await the next instant at which a taxel is sampled that a monitor reads."""
        self._adjust()
        self._due = []
        first = None
        for name in self._read():
            taxel = self._taxels[name]
            frame = taxel.next
            k = max(0, (self._last - frame.start) // frame.dt + 1)
            tick = frame.start + k * frame.dt
            if k >= frame.n or (first is not None and tick > first):
                continue
            if first is None or tick < first:
                first, self._due = tick, []
            self._due.append((taxel, frame, k))
        if first is None:
            self._timer.stop()
            return
        converted = CONVERSION_NS * sum(taxel.inputs for taxel, _, _ in self._due)
        self._machine.arm(self._timer, self._machine.booted + first + converted)

    def skip(self, ticks: int) -> None:
        """Decide at no instant before this one."""
        self._last = max(self._last, ticks - 1)

    def stop(self) -> None:
        """Await nothing."""
        self._timer.stop()

    def _decide(self) -> None:
        """Handle the interrupt after the last conversion of an instant."""
        (_, frame, k), *_ = self._due
        self._last = frame.start + k * frame.dt
        samples = []
        for taxel, own, number in self._due:
            readings, source = taxel.converted(own, number), self._sources[taxel.name]
            source.broken = taxel.broken
            if readings:
                samples.append((source, readings))
        before = self._unit.work
        self._changes: list[tuple[str, bool]] = []
        self._unit.take(self._last, samples)
        due = {taxel.name for taxel, _, _ in self._due}
        cycles = self._cycles(self._defined, self._unit.work - before, due)
        self._machine.ledger.charge_work(cycles)
        now = self._machine.now
        done = now + self._sampling.handle(cycles.span(self._settings.machine.clock_hz))
        for output, level in self._changes:
            self._machine.outputs.drive(output, level=level, time=done, cause=now)
        self.arm()

    def _drive(self, output: str, level: bool) -> None:  # noqa: FBT001 - as the firmware calls it
        self._changes.append((output, level))

    def _read(self) -> list[str]:
        """Names of the taxels that some monitor reads."""
        return list(
            dict.fromkeys(name for defined in self._defined.values() for name in defined.taxels)
        )

    def _atom(self, atom: Atom, compiled: list[_Compiled], meters: dict[str, Meter]) -> engine.Atom:
        """Thresholds where one conversion decides; else the taxels are measured."""
        compared = threshold(atom, self._units)
        if compared is not None:
            name, _, quantity = compared.channel.rpartition(".")
            taxel = self._taxels[name]
            if quantity in taxel.calibrated.monotone:
                derived = quantity in taxel.calibrated.derived
                made = engine.Threshold(self._source(name), 0, derived=derived)
                compiled.append(_Compiled(made, taxel, self._quantity(taxel, quantity), compared))
                return made
        read: list[str] = []

        def measured(channel: str) -> Expression:
            name, _, quantity = channel.rpartition(".")
            read.append(name)
            meter = meters[name] = self._meter(name)
            around = {each: self._meter(each) for each in self._taxels[name].around}
            meter.is_read, meter.around = True, [*around.values()]
            meters.update(around)
            return meter.quantity(self._quantity(self._taxels[name], quantity))

        expression, strict = difference(atom, self._units, measured)
        derived = any(
            quantity in self._taxels[name].calibrated.derived
            for name, _, quantity in (each.rpartition(".") for each in atom.channels)
        )
        sources = [self._source(name) for name in dict.fromkeys(read)]
        return Comparison(sources, expression, strict=strict, derived=derived)

    def _source(self, name: str) -> engine.Source:
        if name not in self._sources:
            taxel = self._taxels[name]
            self._sources[name] = engine.Source(taxel.period, self._drift)
            self._adjusted[name] = _adjustment(taxel)
        return self._sources[name]

    def _meter(self, name: str) -> Meter:
        if name not in self._meters:
            self._meters[name] = Meter(self._source(name), self._taxels[name].calibrated)
        return self._meters[name]

    @staticmethod
    def _quantity(taxel: MonitoredTaxel, quantity: str) -> int:
        return [each for each, _ in taxel.calibrated.quantities].index(quantity)

    def _adjust(self) -> None:
        """Compile thresholds anew where a taxel's settings have changed."""
        for name in self._read():
            taxel, found = self._taxels[name], _adjustment(self._taxels[name])
            if self._adjusted[name] == found:
                continue
            self._adjusted[name] = found
            self._sources[name].sample_every(taxel.period)
            for defined in self._defined.values():
                for each in defined.compiled:
                    if each.taxel is taxel:
                        self._calibrate(each)

    def _calibrate(self, compared: _Compiled) -> None:
        taxel, threshold = compared.taxel, compared.threshold
        ranges = code_ranges(
            taxel.calibrated, 0, compared.quantity, upward=threshold.upward, value=threshold.value
        )
        compared.atom.set(*ranges)
        tried = 2 * (2 + taxel.calibrated.last.bit_length())
        self._machine.ledger.charge_work(inversion(taxel.chain, tried, 0, {}, self._prices))

    def _coverage(self, defined: _Defined) -> float:
        """Probability that all samples hold which a verdict is made of."""
        return union_coverage(
            *(
                union_coverage(
                    self._taxels[name].coverage,
                    n=defined.program.reach // self._taxels[name].period + 2,
                )
                for name in defined.taxels
            )
        )

    def _require_room(self, defined: Mapping[str, _Defined]) -> None:
        machine = self._settings.machine
        if len(defined) > MOST_MONITORS:
            raise MonitorError(f"a node runs {MOST_MONITORS} monitors at most; remove one")
        names = {name for each in defined.values() for name in each.taxels}
        for name in names:
            if self._taxels[name].reads_intervals:
                raise MonitorError(f"{name} plays a recording; a node's monitors read others")
        dt = min(self._taxels[name].period for name in names)
        meters = {id(meter) for each in defined.values() for meter in each.meters}
        size = sum(each.program.memory(dt) for each in defined.values()) + _METER * len(meters)
        free = machine.ram_bytes - ram_budget(self._settings).total
        if size > free:
            raise MonitorError(
                f"the monitors need {size} bytes of RAM, and {free} are free; use shorter windows",
                value=size,
            )
        work = sum(each.program.work for each in defined.values())
        cycles = self._cycles(defined, work, names)
        span, most = cycles.span(machine.clock_hz), min(MOST_WORK_NS, dt // 2)
        if span > most:
            raise MonitorError(
                f"the monitors need up to {cycles.most} cycles at a sample, {span} ns, and {most} "
                f"ns are allowed (half of the sampling period of {dt} ns, at most "
                f"{MOST_WORK_NS}); use fewer operators, a lower rate, or let the cloud evaluate "
                "some",
                value=span,
            )
        needed = processor_load(self._settings, measured_around(self._settings.taxel)).total
        needed += cycles.most * BILLION // dt
        if needed > capacity(self._settings):
            raise MonitorError(
                f"with the monitors the node needs up to {needed} cycles a second, and has "
                f"{capacity(self._settings)}; use fewer operators or a lower rate",
                value=needed,
            )

    def _cycles(
        self, defined: Mapping[str, _Defined], runs: int, names: AbstractSet[str]
    ) -> Cycles:
        """Of all monitors at an instant, at most where some taxels were sampled."""
        total = self._prices["monitor_run"].times(runs)
        for each in defined.values():
            total = total.plus(self._prices["interval_product"].times(each.program.operations))
        measured = {
            name for name, meter in self._meters.items() if name in names and _uses(defined, meter)
        }
        calibrations = set()
        for name in measured:
            taxel = self._taxels[name]
            # Codes that are read along may be new, once for each calibration.
            new = dict.fromkeys(taxel.along, int(id(taxel.calibrated) not in calibrations))
            calibrations.add(id(taxel.calibrated))
            total = total.plus(inversion(taxel.chain, 1, len(taxel.around), new, self._prices))
        return total


def _uses(defined: Mapping[str, _Defined], meter: Meter) -> bool:
    return any(meter in each.meters for each in defined.values())


def _adjustment(taxel: MonitoredTaxel) -> tuple[tuple[float, int, int], int]:
    """What thresholds depend on, and the period."""
    return taxel.adjustment, taxel.period
