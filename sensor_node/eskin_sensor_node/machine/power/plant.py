"""The power plant: harvest, consumption, brown-out and recovery."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.wire.messages import ResetCause
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.machine.power.harvest import Harvester, Layers
from eskin_sensor_node.machine.power.supply import Supply
from eskin_sensor_node.machine.work_counters import WorkCounters
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.machine.machine import Machine
    from eskin_sensor_node.settings import EnergySection

STEP: Final = BILLION // 4
"""ns from one look at the supply to the next."""


class PowerPlant:
    """Hardware beside the machine: it goes on through every reset.

    Args:
        machine: Which it feeds, and stops below the brown-out voltage.
        section: Data sheets of its parts.
        taxels: Those whose touches it harvests.
        seed: The node's and a number among its taxels; they draw the true parts.
        watch: Takes, while the firmware runs, the supply's code and the work since the last look.
    """

    def __init__(
        self,
        machine: Machine,
        section: EnergySection,
        *,
        taxels: Sequence[TaxelSection],
        seed: tuple[int, ...],
        watch: Callable[[int, WorkCounters], None],
    ) -> None:
        random = ColumnGenerator(*seed)
        self.supply = Supply(section, random)
        self._layers = Layers(section, random)
        self._harvester = Harvester(taxels)
        self._machine = machine
        self._watch = watch
        self._passed = machine.now
        machine.events.every(STEP, self.look)

    def look(self) -> None:
        """Bring the supply up to the present, and let the firmware measure it."""
        machine, supply = self._machine, self.supply
        span = machine.now - self._passed
        self._passed = machine.now
        # Without power it works nothing, and its ledger is closed.
        work = WorkCounters(span=span)
        if machine.on:
            work = machine.ledger.take(machine.now)._replace(span=span)
        touches = self._harvester.touches(machine.now / BILLION)
        supply.pass_span(work, self._layers.energy(touches))
        if machine.on and supply.failing:
            machine.power_off(ResetCause.BROWN_OUT)
        elif not machine.on and machine.cause == ResetCause.BROWN_OUT and supply.restored:
            machine.power_on()
        if machine.running:
            self._watch(supply.code(), work)
