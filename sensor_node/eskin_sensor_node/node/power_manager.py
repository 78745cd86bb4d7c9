"""A node that lives on its supply: the firmware's energy manager between hardware and sampling."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from eskin.errors import FlashError
from eskin.wire.messages import Shedding
from eskin_sensor_node.firmware.energy import SLEEP, EnergyManager
from eskin_sensor_node.firmware.states import SCARCE
from eskin_sensor_node.machine.crystal import BILLION
from eskin_sensor_node.machine.power.data_sheet import energy_sheet
from eskin_sensor_node.machine.power.plant import PowerPlant

if TYPE_CHECKING:
    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.machine.work_counters import WorkCounters
    from eskin_sensor_node.node.ground_truth import GroundTruth
    from eskin_sensor_node.node.node import Node
    from eskin_sensor_node.settings import NodeSettings

log = logging.getLogger(__name__)

_KEEP_EVERY: Final = 5 * BILLION
"""Machine time between two records of the true charge: a process may end without a word."""


class PowerManager:
    """Sheds the node's load in stages, and takes it up again.

    The supercapacitor outlives the process: what it truly holds stands in the truth, what the
    firmware knew of it at an orderly end in flash.

    Args:
        node: Which lives on the supply.
        settings: The node's.
        clock: Its clock.
        outbox: Keeps what the firmware knows of the charge.
        truth: Keeps the true charge.
        seed: Draws the true supply.

    Attributes:
        plant: The hardware.
        manager: What the firmware knows; each start makes it anew.
    """

    def __init__(
        self,
        node: Node,
        settings: NodeSettings,
        *,
        clock: Clock,
        outbox: Outbox,
        truth: GroundTruth,
        seed: int,
    ) -> None:
        self._node, self._clock, self._outbox, self._truth = node, clock, outbox, truth
        self._kept = 0
        self._sheet = energy_sheet(settings.energy)
        self.plant = PowerPlant(
            node.machine,
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
        """Start the firmware's part: nothing is left of what its RAM held, only flash."""
        self.manager = EnergyManager(self._sheet)
        record = self._outbox.charge()
        if not record:
            return
        # It counts once: what a life spends that ends without a word, nobody knows.
        try:
            with self._outbox.batch() as batch:
                batch.keep_charge(b"")
        except FlashError as error:
            log.warning("energy: what was kept of the charge is not used: error=%s", error)
        else:
            self.manager.recall(record, self._clock.known.enclosure(0))

    def keep(self) -> None:
        """Keep the true charge, now and then.

        Raises:
            FlashError: It cannot be written.
        """
        if self._node.machine.now - self._kept >= _KEEP_EVERY:
            self._keep()

    def rest(self) -> None:
        """Look at the supply for the last time, and keep what is known of it.

        Raises:
            FlashError: It cannot be written.
        """
        self.plant.look()
        self._keep()
        if self._node.machine.running:
            with self._outbox.batch() as batch:
                batch.keep_charge(self.manager.rest(self._clock.known.enclosure(self._ticks)))

    @property
    def _ticks(self) -> int:
        return self._node.machine.now - self._node.machine.booted

    def _keep(self) -> None:
        self._kept = self._node.machine.now
        now = self._clock.true_time(self._ticks)
        self._truth.keep_supply(self._name, now, self.plant.supply.energy)

    def _watch(self, code: int, work: WorkCounters) -> None:
        before = self.manager.stage
        self.manager.watch(code, work)
        stage = self.manager.stage
        if stage == before:
            return
        log.warning("energy: load shed=%s", Shedding(stage).name.lower())
        for taxel in self._node.taxels:
            taxel.control_unit.shed = stage
        if stage == SLEEP:
            self._node.shed(SCARCE)
        elif before == SLEEP:
            self._node.resume()


def keep_energy(
    node: Node,
    settings: NodeSettings,
    *,
    clock: Clock,
    outbox: Outbox,
    truth: GroundTruth,
    seed: int,
) -> PowerManager | None:
    """A node's keeper; ``None`` where its supply never ends."""
    if not settings.energy.on:
        return None
    return PowerManager(node, settings, clock=clock, outbox=outbox, truth=truth, seed=seed)
