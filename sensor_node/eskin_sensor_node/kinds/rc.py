"""The chain of Fig. 3: RC oscillator, frequency detector, V to I converter, ADC."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import ValidationInfo, field_validator

from eskin_sensor_node.firmware.taxel.capacitive import CapacitiveTaxel
from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.frontend import Frontend
from eskin_sensor_node.kinds.parameters import draw_noise, draw_part
from eskin_sensor_node.kinds.settings import Positive, Rate, TaxelSection, Tolerance, above, unit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.firmware.taxel.taxel import Taxel
    from eskin_sensor_node.kinds.frontend import Digitised
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.noise import GaussianNoise, UniformNoise


class RcSection(TaxelSection):
    """Fig. 3: RC oscillator, frequency detector, V→I converter, ADC."""

    sampling: Rate = unit("sampling_Hz", 1000.0)
    resistance_ohm: Positive = 1e3
    resistance_tolerance: Tolerance = 1e-3
    reference: Positive = unit("reference_Hz")
    reference_tolerance: Tolerance = 1e-5
    transconductance: Positive = unit("transconductance_A_per_V", 1e-3)
    transconductance_tolerance: Tolerance = 1e-3
    adc_min: float = unit("adc_min_A", 0.0, ge=0)
    adc_max: float = unit("adc_max_A", 1e-3)

    @field_validator("adc_max")
    @classmethod
    def _adc_range(cls, value: float, info: ValidationInfo) -> float:
        return above(info, value, "adc_min_A", "adc_min")


class CapacitanceSection(RcSection):
    """What all taxels have whose capacitance is measured (eq. 6). Noise: in A, before the ADC."""

    firmware: ClassVar[type[Taxel]] = CapacitiveTaxel

    capacitance_prominence: Positive | None = unit("capacitance_prominence_F", None)
    current_prominence: Positive | None = unit("current_prominence_A", None)


class RcFrontend(Frontend):
    """C → RC oscillator (eq. 6) → V = f/f_ref → I = Gm·V → ADC.

    Args:
        taxel: Its data sheet.
        random: Draws the true parts.
    """

    def __init__(self, taxel: RcSection, random: ColumnGenerator) -> None:
        self._resistance = draw_part(random, taxel.resistance_ohm, taxel.resistance_tolerance)
        self._reference = draw_part(random, taxel.reference, taxel.reference_tolerance)
        self._transconductance = draw_part(
            random, taxel.transconductance, taxel.transconductance_tolerance
        )
        self._converter = Converter(taxel, random)
        # Before the ADC; ``None`` where the taxel is disturbed before the chain.
        self._noise: UniformNoise | GaussianNoise | None = taxel.noise

    def digitise(self, sensed: Mapping[str, Floats], random: ColumnGenerator) -> Digitised:
        """Codes of the current."""
        frequency = 1.0 / (2.0 * np.pi * self._resistance * sensed["capacitance"])
        current = np.asarray(self._transconductance * (frequency / self._reference))
        noisy = current
        if self._noise is not None:
            noisy = current + draw_noise(random, self._noise)
        return self._digitised({"current": current}, {"current": noisy})
