"""The chain of the ICM hybrid."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.frontend import Frontend
from eskin_sensor_node.kinds.parameters import draw_noise, draw_part

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.frontend import Digitised
    from eskin_sensor_node.kinds.hybrid.settings import HybridSection


class HybridFrontend(Frontend):
    """Current and voltage, each through an amplifier to a bipolar ADC."""

    def __init__(self, taxel: HybridSection, random: np.random.Generator) -> None:
        self._gains = {
            "current": draw_part(random, taxel.current_gain, taxel.current_gain_tolerance),
            "voltage": draw_part(random, taxel.voltage_gain, taxel.voltage_gain_tolerance),
        }
        self._converter = Converter(taxel, random)
        self._noise = taxel.noise

    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Codes of both amplifiers' voltages."""
        held = {
            quantity: gain * sensed[quantity]
            + draw_noise(random, self._noise, sensed[quantity].shape)
            for quantity, gain in self._gains.items()
        }
        return self._digitised({}, held)
