"""Reflexes: monitors that run at each sample, and drive outputs of the machine at once."""

from array import array

from eskin_sensor_node.firmware.gesture_lock import WAITING
from eskin_sensor_node.firmware.monitor import IMPOSSIBLE, NEVER

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin_sensor_node.firmware.assembler import Assembler
    from eskin_sensor_node.firmware.clock import Clock
    from eskin_sensor_node.firmware.expression import Meter
    from eskin_sensor_node.firmware.gesture_lock import GestureLock
    from eskin_sensor_node.firmware.monitor import Codes, Monitor, Readings, Source
    from eskin_sensor_node.firmware.taxel.taxel import Taxel


class Reflex:
    """A monitor with what follows from its verdict.

    Args:
        name: The monitor's.
        monitor: Decides.
        on: The least verdict with which its output is on.
        output: Name of the output; empty for none.
        coverage: Probability that a verdict holds, at least.
        meters: What measures for its atoms.
        secret: Whether its verdicts are not stated.

    Attributes:
        is_on: Whether its verdict asks for the output.
    """

    def __init__(
        self,
        name: str,
        monitor: "Monitor",
        on: int,
        output: str,
        coverage: float,
        meters: "Sequence[Meter]" = (),
        *,
        secret: bool = False,
    ) -> None:
        self.name = name
        self.monitor = monitor
        self.on = on
        self.output = output
        self.coverage = coverage
        self.meters = meters
        self.secret = secret
        self.is_on = False
        self._stated = -1

    def compare(self, now: int) -> bool:
        """Compare atoms one of whose taxels was sampled now; gives whether there is any."""
        found = False
        for atom in self.monitor.atoms:
            if any(source.fresh for source in atom.sources):
                atom.take(now)
                found = True
        return found

    def decide(self, now: int, clock: "Clock", assembler: "Assembler") -> None:
        """Decide at an instant, and state a verdict that differs from the one before."""
        verdict = self.monitor.step(now)
        self.is_on = verdict >= self.on > IMPOSSIBLE
        if verdict != self._stated and not self.secret:
            self._stated = verdict
            time = clock.enclosure(now)
            assembler.state_verdict(self.name, time, verdict, self.monitor.because, self.coverage)


class ReflexUnit:
    """All reflexes of a node.

    Args:
        clock: What the node knows of time.
        assembler: Takes verdicts.
        drive: Sets an output, by its name.
        lock: Takes the verdicts of its gestures; ``None``: there is none.

    Attributes:
        reflexes: By their names.
    """

    def __init__(
        self,
        clock: "Clock",
        assembler: "Assembler",
        drive: "Callable[[str, bool], None]",
        lock: "GestureLock | None" = None,
    ) -> None:
        self._clock = clock
        self._assembler = assembler
        self._drive = drive
        self._lock = lock
        self.reflexes: dict[str, Reflex] = {}
        self._meters: list[Meter] = []
        self._levels: dict[str, bool] = {}

    def define(self, reflex: Reflex) -> None:
        """Add a reflex, in place of one of its name."""
        self.reflexes[reflex.name] = reflex
        self._changed()

    def remove(self, name: str) -> None:
        """Remove a reflex; its output is off unless another one asks for it."""
        del self.reflexes[name]
        self._changed()

    @property
    def work(self) -> int:
        """How many runs all monitors took so far."""
        return sum(each.monitor.work for each in self.reflexes.values())

    def take(self, now: int, samples: "Sequence[tuple[Source, Readings]]") -> None:
        """Decide with what some taxels were sampled as now: the codes of their inputs."""
        for source, readings in samples:
            source.take(now, readings)
        fresh = [meter for meter in self._meters if meter.source.fresh]
        for meter in fresh:
            meter.measure()
        for meter in fresh:
            if meter.is_read:
                meter.separate()
        for reflex in self.reflexes.values():
            if reflex.compare(now):
                reflex.decide(now, self._clock, self._assembler)
        for source, _ in samples:
            source.fresh = False
        lock = self._lock
        if lock is not None and lock.outcome == WAITING:
            verdicts = {name: self.reflexes[name].monitor.verdict for name in lock.gestures}
            lock.take(now, verdicts)
        self._drive_outputs()

    def _changed(self) -> None:
        meters: list[Meter] = []
        for reflex in self.reflexes.values():
            for meter in reflex.meters:
                if meter not in meters:
                    meters.append(meter)
        self._meters = meters
        self._drive_outputs()

    def _drive_outputs(self) -> None:
        wanted = dict.fromkeys(self._levels, False)
        for reflex in self.reflexes.values():
            if reflex.output:
                wanted[reflex.output] = wanted.get(reflex.output, False) or reflex.is_on
        for name, level in wanted.items():
            if level is not self._levels.get(name, False):
                self._drive(name, level)
        self._levels = wanted


def code_ranges(
    taxel: "Taxel", place: int, quantity: int, *, upward: bool, value: float
) -> "tuple[Codes, Codes]":
    """Codes whose bounds fulfil a comparison: for certain, and possibly.

    The quantity is one of `Taxel.monotone`: its bounds ascend with the code, or descend. So those
    codes are all from one on, or up to one, which bisection finds.

    Args:
        taxel: Its calibration, as it is adjusted at present.
        place: Which of its inputs the quantity follows from.
        quantity: Which of its quantities.
        upward: Whether values that are not less than the threshold fulfil it; else, not greater.
        value: The threshold.
    """
    codes = [array("q", [0]) for _ in taxel.inputs]
    bounds = [array("d", [0.0]) for _ in range(2 * len(taxel.quantities))]

    def fulfils(code: int, side: int) -> bool:
        codes[place][0] = code
        taxel.measure(codes, 1, bounds)
        bound = bounds[2 * quantity + side][0]
        return bound >= value if upward else bound <= value

    # What holds at the end that is nearer to failing holds for certain.
    near = 0 if upward else 1
    return (
        _bisected(taxel.last, lambda code: fulfils(code, near)),
        _bisected(taxel.last, lambda code: fulfils(code, 1 - near)),
    )


def _bisected(last: int, fulfils: "Callable[[int], bool]") -> "Codes":
    """The codes that fulfil a monotone condition."""
    low, high = 0, last
    first, end = fulfils(low), fulfils(high)
    if first and end:
        return 0, last
    if not first and not end:
        return NEVER
    while high - low > 1:
        middle = (low + high) // 2
        if fulfils(middle) == first:
            low = middle
        else:
            high = middle
    return (0, low) if first else (high, last)
