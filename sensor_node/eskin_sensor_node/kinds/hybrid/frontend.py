"""The chain of the ICM hybrid."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.frontend import Frontend
from eskin_sensor_node.kinds.parameters import draw_noise, draw_part

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.frontend import Digitised
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.hybrid.settings import HybridSection


class HybridFrontend(Frontend):
    """Current and voltage, each through an amplifier to a bipolar ADC."""

    def __init__(self, taxel: HybridSection, random: ColumnGenerator) -> None:
        self._gains = {
            "current": draw_part(random, taxel.current_gain, taxel.current_gain_tolerance),
            "voltage": draw_part(random, taxel.voltage_gain, taxel.voltage_gain_tolerance),
        }
        self._converter = Converter(taxel, random)
        self._noise = taxel.noise

    def digitise(self, sensed: Mapping[str, Floats], random: ColumnGenerator) -> Digitised:
        """Codes of both amplifiers' voltages."""
        held = {
            quantity: gain * sensed[quantity] + draw_noise(random, self._noise)
            for quantity, gain in self._gains.items()
        }
        return self._digitised({}, held)
