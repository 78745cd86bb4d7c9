"""The chains of a coil of a skin."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.frontend import Digitised
from eskin_sensor_node.kinds.lc import LcFrontend
from eskin_sensor_node.kinds.parameters import draw_noise, draw_part

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.coil.settings import CoilSection
    from eskin_sensor_node.kinds.generator import ColumnGenerator


class CoilFrontend(LcFrontend):
    """Beside the oscillator's: the coil's driven current → two synchronous demodulators → ADCs."""

    def __init__(self, taxel: CoilSection, random: ColumnGenerator) -> None:
        super().__init__(taxel, random)
        drive = draw_part(random, taxel.drive, taxel.drive_tolerance)
        self._drive = drive * draw_part(
            random, taxel.demodulator_gain, taxel.demodulator_gain_tolerance
        )
        # No amplifier and no trimmer before them.
        own = taxel.model_copy(
            update={
                "adc_min": 0.0,
                "adc_max": taxel.demodulator_max,
                "gain_tolerance": 0.0,
                "trimmer_steps": 0,
            }
        )
        self._demodulators = {
            "in_phase": ("conductance", Converter(own, random)),
            "quadrature": ("susceptance", Converter(own, random)),
        }

    def digitise(self, sensed: Mapping[str, Floats], random: ColumnGenerator) -> Digitised:
        """Codes of the detector's voltage, and of the current's two parts."""
        oscillator = super().digitise(sensed, random)
        codes = {
            name: converter.convert(self._drive * sensed[part] + draw_noise(random, self._noise))
            for name, (part, converter) in self._demodulators.items()
        }
        return Digitised(oscillator.truth, oscillator.codes | codes, oscillator.held)
