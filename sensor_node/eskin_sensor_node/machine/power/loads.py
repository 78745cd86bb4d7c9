"""Energy of the machine's work: by the data sheet, and true."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.interval import Interval
from eskin_sensor_node.kinds.parameters import draw_part
from eskin_sensor_node.machine.power.data_sheet import idle_power, pulse_energy

if TYPE_CHECKING:
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.machine.work_counters import WorkCounters
    from eskin_sensor_node.settings import EnergySection

_BILLION: Final = 1_000_000_000


class Costs(NamedTuple):
    """Energy in J by part."""

    sensing: float
    converting: float
    computing: float
    radio: float
    flash: float
    idle: float
    sleeping: float
    waking: float


class Loads:
    """The true loads of one node, drawn from inside the data sheet's tolerances.

    Args:
        sheet: The data sheet.
        random: Draws the true costs.
    """

    def __init__(self, sheet: EnergySection, random: ColumnGenerator) -> None:
        self._pulse = _drawn(random, pulse_energy(sheet))
        self._idle = _drawn(random, idle_power(sheet))
        self._more = random.uniform(0.05, 0.95).item()
        self._written = draw_part(random, sheet.written, sheet.written_tolerance).item()
        self._conversion = draw_part(random, sheet.conversion, sheet.conversion_tolerance).item()
        self._cycle = draw_part(random, sheet.cycle, sheet.cycle_tolerance).item()
        self._sent = draw_part(random, sheet.sent, sheet.sent_tolerance).item()
        self._received = draw_part(random, sheet.received, sheet.received_tolerance).item()
        self._sleeping = draw_part(random, sheet.sleeping, sheet.sleeping_tolerance).item()
        self._wake_up = draw_part(random, sheet.wake_up, sheet.wake_up_tolerance).item()

    def costs(self, work: WorkCounters) -> Costs:
        """True energies of some work."""
        cycles = work.fewest + self._more * (work.cycles - work.fewest)
        return Costs(
            work.conversions * self._pulse,
            work.conversions * self._conversion,
            cycles * self._cycle,
            work.sent * self._sent + work.received * self._received,
            work.written * self._written,
            work.on / _BILLION * self._idle,
            work.asleep / _BILLION * self._sleeping,
            work.wakes * self._wake_up,
        )


def _drawn(random: ColumnGenerator, bounds: Interval) -> float:
    low, high = float(bounds.inf), float(bounds.sup)
    return low + (high - low) * random.uniform(0.05, 0.95).item()


def bounds(sheet: EnergySection, work: WorkCounters) -> dict[str, Interval]:
    """Energies of some work in J by part, as the data sheet bounds them."""

    def each(name: str) -> Interval:
        return Interval.relative(getattr(sheet, name), getattr(sheet, f"{name}_tolerance"))

    return {
        "sensing": pulse_energy(sheet) * work.conversions,
        "converting": each("conversion") * work.conversions,
        "computing": each("cycle") * Interval(work.fewest, work.cycles),
        "radio": each("sent") * work.sent + each("received") * work.received,
        "flash": each("written") * work.written,
        "idle": idle_power(sheet) * (Interval(work.on) / _BILLION),
        "sleeping": each("sleeping") * (Interval(work.asleep, work.on) / _BILLION),
        "waking": each("wake_up") * work.wakes,
    }
