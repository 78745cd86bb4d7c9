"""The temperature of a scenario's air."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.world.scenario import read_scenario

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.thermometer.settings import ThermometerSection


class ThermometerWorld(World):
    """Temperature of the air."""

    def __init__(self, taxel: ThermometerSection, random: ColumnGenerator) -> None:
        del random
        self._script = read_scenario(taxel.scenario)

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """True temperature in °C."""
        del random
        _, local = self._script.local(seconds)
        truth = {"temperature": self._script.ambient.temperature(local)}
        return Signals(truth, truth)
