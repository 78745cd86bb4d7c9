"""The chain of an electrode."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.frontend import Frontend
from eskin_sensor_node.kinds.parameters import draw_noise, draw_part

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.bioelectric.settings import BioelectricSection
    from eskin_sensor_node.kinds.frontend import Digitised
    from eskin_sensor_node.kinds.generator import ColumnGenerator


class BioelectricFrontend(Frontend):
    """Voltage of the skin → amplifier with an offset → bipolar ADC."""

    def __init__(self, taxel: BioelectricSection, random: ColumnGenerator) -> None:
        self._gain = draw_part(random, taxel.electrode_gain, taxel.electrode_gain_tolerance)
        self._offset = taxel.input_offset * random.uniform(-1.0, 1.0)
        self._converter = Converter(taxel, random)
        self._noise = taxel.noise

    def digitise(self, sensed: Mapping[str, Floats], random: ColumnGenerator) -> Digitised:
        """Codes of the amplifier's voltage."""
        voltage = self._gain * (sensed["bioelectric"] + self._offset)
        noisy = voltage + draw_noise(random, self._noise)
        return self._digitised({}, {"voltage": noisy})
