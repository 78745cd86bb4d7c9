"""The voltage that the body of a scenario makes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.world.scenario import read_scenario

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_sensor_node.kinds.bioelectric.settings import BioelectricSection
    from eskin_sensor_node.kinds.generator import ColumnGenerator


class BioelectricWorld(World):
    """Voltage under an electrode."""

    def __init__(self, taxel: BioelectricSection, random: ColumnGenerator) -> None:
        del random
        self._bioelectric = read_scenario(taxel.scenario).bioelectric

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """True voltage in V."""
        del random
        truth = {"bioelectric": self._bioelectric.voltage(seconds)}
        return Signals(truth, truth)
