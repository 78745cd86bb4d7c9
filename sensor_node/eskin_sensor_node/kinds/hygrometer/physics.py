"""The humidity of a scenario's air."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.world.scenario import read_scenario

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.hygrometer.settings import HygrometerSection


class HygrometerWorld(World):
    """Humidity of the air."""

    def __init__(self, taxel: HygrometerSection, random: ColumnGenerator) -> None:
        del random
        self._script = read_scenario(taxel.scenario)

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """True humidity in %."""
        del random
        _, local = self._script.local(seconds)
        truth = {"humidity": self._script.ambient.humidity(local)}
        return Signals(truth, truth)
