"""The firmware's energy manager, between the power plant and sampling."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from eskin.errors import FlashError
from eskin.wire.messages import Shedding
from eskin_sensor_node.firmware.energy import EnergyManager
from eskin_sensor_node.machine.power.data_sheet import energy_sheet
from eskin_sensor_node.machine.power.plant import PowerPlant
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.machine.machine import Machine
    from eskin_sensor_node.machine.work_counters import WorkCounters
    from eskin_sensor_node.node.ground_truth import GroundTruth
    from eskin_sensor_node.settings import NodeSettings

log = logging.getLogger(__name__)

_KEEP_EVERY: Final = 5 * BILLION
"""Machine time between two records of the true charge, for a process that is killed."""


class PowerManager:
    """Sheds the node's load in stages, and takes it up again.

    The supercapacitor outlives the process: the ground truth keeps its true energy, flash what the
    firmware knew of it at an orderly end.

    Args:
        machine: The node's, which runs on the supply.
        settings: The node's.
        clock: Its clock.
        outbox: Keeps what the firmware knows of the charge.
        truth: Keeps the true charge.
        seed: Draws the true supply.
        on_stage: Called with the stage of shedding and the one before, when it changes.

    Attributes:
        plant: The hardware.
        manager: What the firmware knows; each boot makes it anew.
    """

    def __init__(
        self,
        machine: Machine,
        settings: NodeSettings,
        *,
        clock: Clock,
        outbox: Outbox,
        truth: GroundTruth,
        seed: int,
        on_stage: Callable[[int, int], None],
    ) -> None:
        self._machine, self._clock, self._outbox, self._truth = machine, clock, outbox, truth
        self._on_stage = on_stage
        self._stored_at = 0
        self._sheet = energy_sheet(settings.energy)
        self.plant = PowerPlant(
            machine,
            settings.energy,
            taxels=settings.taxel,
            seed=(seed, len(settings.taxel)),
            watch=self._watch,
        )
        self._name = settings.node.name
        before = truth.supply(self._name)
        if before is not None:
            away = max(0, clock.true_time(0) - before[0])
            self.plant.supply.rest(before[1], away / BILLION)

    def boot(self) -> None:
        """Start the firmware's part from what flash holds."""
        self.manager = EnergyManager(self._sheet)
        record = self._outbox.charge()
        if not record:
            return
        # Used once: after a power cut, what the last boot has spent is unknown.
        try:
            with self._outbox.batch() as batch:
                batch.store_charge(b"")
        except FlashError as error:
            log.warning("stored charge not used: error=%s", error)
        else:
            self.manager.recall(record, self._clock.known.enclosure(0))

    def keep(self) -> None:
        """Store the true charge from time to time.

        Raises:
            FlashError: It cannot be written.
        """
        if self._machine.now - self._stored_at >= _KEEP_EVERY:
            self._keep()

    def rest(self) -> None:
        """Measure the supply for the last time, and store the charge.

        Raises:
            FlashError: It cannot be written.
        """
        self.plant.look()
        self._keep()
        if self._machine.running:
            with self._outbox.batch() as batch:
                batch.store_charge(self.manager.rest(self._clock.known.enclosure(self._ticks)))

    @property
    def _ticks(self) -> int:
        return self._machine.now - self._machine.booted

    def _keep(self) -> None:
        self._stored_at = self._machine.now
        now = self._clock.true_time(self._ticks)
        self._truth.store_supply(self._name, now, self.plant.supply.energy)

    def _watch(self, code: int, work: WorkCounters) -> None:
        before = self.manager.stage
        self.manager.watch(code, work)
        stage = self.manager.stage
        if stage == before:
            return
        log.warning("load shed: stage=%s", Shedding(stage).name.lower())
        self._on_stage(stage, before)
