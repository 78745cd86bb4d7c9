"""A node that lives on its supply: the firmware's energy manager between hardware and sampling."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from eskin.messages import Shedding
from sensor_node.firmware.energy import SLEEP, EnergyManager
from sensor_node.firmware.states import SCARCE
from sensor_node.machine.power.plant import PowerPlant
from sensor_node.machine.power.sheet import energy_sheet

if TYPE_CHECKING:
    from sensor_node.machine.work import Work
    from sensor_node.node import Node
    from sensor_node.settings import NodeSettings

log = logging.getLogger(__name__)


class EnergyKeeper:
    """Sheds the node's load in stages, and takes it up again.

    Args:
        node: Which lives on the supply.
        settings: The node's.
        seed: Draws the true supply.

    Attributes:
        plant: The hardware.
        manager: What the firmware knows; each start makes it anew.
    """

    def __init__(self, node: Node, settings: NodeSettings, *, seed: int) -> None:
        self._node = node
        self._sheet = energy_sheet(settings.energy)
        self.plant = PowerPlant(
            node.machine,
            settings.energy,
            taxels=settings.taxel,
            seed=(seed, len(settings.taxel)),
            watch=self._watch,
        )
        self.boot()

    def boot(self) -> None:
        """Start the firmware's part: nothing is left of what its RAM held."""
        self.manager = EnergyManager(self._sheet)

    def _watch(self, code: int, work: Work) -> None:
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
