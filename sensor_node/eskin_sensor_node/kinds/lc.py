"""The chain of a coil: LC oscillator, frequency detector, ADC."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import ValidationInfo, field_validator

from eskin_sensor_node.firmware.taxel.inductive import InductiveTaxel
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


class LcSection(TaxelSection):
    """What all taxels have that see metal by a coil (eq. 11, 12). Noise: in V, before the ADC."""

    firmware: ClassVar[type[Taxel]] = InductiveTaxel

    sampling: Rate = unit("sampling_Hz", 1000.0)
    inductance: Positive = unit("inductance_H", 10e-3)
    inductance_tolerance: Tolerance = 1e-3
    inductance_change: Positive = unit("inductance_change_H", 5e-3)
    inductance_change_tolerance: Tolerance = 2e-3
    damping_per_m: Positive = 10.0
    damping_tolerance: Tolerance = 2e-3
    capacitance: Positive = unit("capacitance_F", 1e-6)
    capacitance_tolerance: Tolerance = 1e-3
    reference: Positive = unit("reference_Hz", 2500.0)
    reference_tolerance: Tolerance = 1e-5
    adc_min: float = unit("adc_min_V", 0.75, ge=0)
    adc_max: float = unit("adc_max_V", 0.9)
    frequency_prominence: Positive | None = unit("frequency_prominence_Hz", None)
    inductance_prominence: Positive | None = unit("inductance_prominence_H", None)
    distance_prominence: Positive | None = unit("distance_prominence_m", None)

    @field_validator("inductance_change")
    @classmethod
    def _coil_stays_a_coil(cls, value: float, info: ValidationInfo) -> float:
        base, tolerance = info.data.get("inductance"), info.data.get("inductance_tolerance")
        if base is not None and tolerance is not None and value >= 0.6 * base * (1 - tolerance):
            raise ValueError(
                f"it must be less than 0.6 of inductance_H = {base!r} at its lower tolerance"
            )
        return value

    @field_validator("adc_max")
    @classmethod
    def _adc_range(cls, value: float, info: ValidationInfo) -> float:
        return above(info, value, "adc_min_V", "adc_min")


class LcFrontend(Frontend):
    """L → LC oscillator (eq. 12) → V = f/f_ref → ADC."""

    def __init__(self, taxel: LcSection, random: ColumnGenerator) -> None:
        self._capacitance = draw_part(random, taxel.capacitance, taxel.capacitance_tolerance)
        self._reference = draw_part(random, taxel.reference, taxel.reference_tolerance)
        self._converter = Converter(taxel, random)
        self._noise = taxel.noise

    def digitise(self, sensed: Mapping[str, Floats], random: ColumnGenerator) -> Digitised:
        """Codes of the detector's voltage."""
        frequency = 1.0 / (2.0 * np.pi * np.sqrt(sensed["inductance"] * self._capacitance))
        voltage = frequency / self._reference
        noisy = voltage + draw_noise(random, self._noise)
        return self._digitised({"frequency": frequency}, {"voltage": noisy})
