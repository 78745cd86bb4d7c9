"""What work costs: as the data sheet says, and truly."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.interval import Interval
from sensor_node.machine.power.pulse import pulse_energy
from sensor_node.physics.parameters import draw_part

if TYPE_CHECKING:
    import numpy as np

    from sensor_node.machine.power.section import EnergySection
    from sensor_node.machine.work import Work

_BILLION: Final = 1_000_000_000


class Costs(NamedTuple):
    """Energy in J by part."""

    sensing: float
    converting: float
    computing: float
    radio: float
    sleeping: float
    waking: float


class Loads:
    """The true loads of one node, drawn from inside the data sheet's tolerances.

    Args:
        sheet: The data sheet.
        random: Draws the true costs.
    """

    def __init__(self, sheet: EnergySection, random: np.random.Generator) -> None:
        pulse = pulse_energy(sheet)
        low, high = float(pulse.inf), float(pulse.sup)
        self._pulse = low + (high - low) * float(random.uniform(0.05, 0.95))
        self._conversion = draw_part(random, sheet.conversion, sheet.conversion_tolerance)
        self._instruction = draw_part(random, sheet.instruction, sheet.instruction_tolerance)
        self._sent = draw_part(random, sheet.sent, sheet.sent_tolerance)
        self._received = draw_part(random, sheet.received, sheet.received_tolerance)
        self._sleeping = draw_part(random, sheet.sleeping, sheet.sleeping_tolerance)
        self._wake_up = draw_part(random, sheet.wake_up, sheet.wake_up_tolerance)

    def costs(self, work: Work) -> Costs:
        """True energies of some work."""
        return Costs(
            work.conversions * self._pulse,
            work.conversions * self._conversion,
            work.instructions * self._instruction,
            work.sent * self._sent + work.received * self._received,
            work.asleep / _BILLION * self._sleeping,
            work.wakes * self._wake_up,
        )


def bounds(sheet: EnergySection, work: Work) -> dict[str, Interval]:
    """Energies of some work in J by part, as the data sheet bounds them."""

    def each(name: str) -> Interval:
        return Interval.relative(getattr(sheet, name), getattr(sheet, f"{name}_tolerance"))

    return {
        "sensing": pulse_energy(sheet) * work.conversions,
        "converting": each("conversion") * work.conversions,
        "computing": each("instruction") * work.instructions,
        "radio": each("sent") * work.sent + each("received") * work.received,
        "sleeping": each("sleeping") * (Interval(work.asleep) / _BILLION),
        "waking": each("wake_up") * work.wakes,
    }
