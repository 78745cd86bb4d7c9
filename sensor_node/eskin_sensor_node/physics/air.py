"""The air and the body that a scenario has around a skin."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.physics.signals import Signals
from eskin_sensor_node.world.scenario import read_scenario

if TYPE_CHECKING:
    import numpy as np

    from eskin.interval import Floats
    from eskin_sensor_node.taxels import BioelectricSection, HygrometerSection, ThermometerSection


class AirWorld:
    """Temperature and humidity of a scenario."""

    def __init__(self, taxel: ThermometerSection | HygrometerSection) -> None:
        self._script = read_scenario(taxel.scenario)

    def signals(self, seconds: Floats, random: np.random.Generator) -> Signals:
        """True temperature in °C and relative humidity in %."""
        del random
        _, local = self._script.local(seconds)
        ambient = self._script.ambient
        truth = {"temperature": ambient.temperature(local), "humidity": ambient.humidity(local)}
        return Signals(truth, truth)


class BodyWorld:
    """Voltage that the body of a scenario makes."""

    def __init__(self, taxel: BioelectricSection) -> None:
        self._bioelectric = read_scenario(taxel.scenario).bioelectric

    def signals(self, seconds: Floats, random: np.random.Generator) -> Signals:
        """True voltage in V."""
        del random
        truth = {"bioelectric": self._bioelectric.voltage(seconds)}
        return Signals(truth, truth)
