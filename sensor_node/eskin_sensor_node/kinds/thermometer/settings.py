"""Settings of a platinum resistor that measures the temperature."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from eskin_sensor_node.firmware.taxel.thermometer import ThermometerTaxel
from eskin_sensor_node.kinds.settings import Positive, Rate, TaxelSection, Tolerance, above, unit
from eskin_sensor_node.world.scenario.fit import Played


class ThermometerSection(Played, TaxelSection):
    """Platinum resistor in a divider (IEC 60751). Noise: as a share of the supply, before the ADC.

    The divider's supply is the converter's reference, too, so that it cancels.
    """

    firmware: ClassVar[type[ThermometerTaxel]] = ThermometerTaxel

    kind: Literal["thermometer"]
    sampling: Rate = unit("sampling_Hz", 50.0)
    nominal_ohm: Positive = Field(default=1000.0, description="at 0 °C, without its tolerance")
    tolerance_K: float = Field(default=0.15, ge=0, le=10, description="class A: 0.15, B: 0.3")
    tolerance_per_K: float = Field(
        default=0.002, ge=0, le=0.05, description="for each K away from 0 °C; A: 0.002, B: 0.005"
    )
    series_resistance_ohm: Positive = 1000.0
    series_resistance_tolerance: Tolerance = 1e-4
    adc_min: float = Field(default=0.44, ge=0, lt=1, description="share of the supply")
    adc_max: float = Field(default=0.6, gt=0, lt=1, description="share of the supply")
    temperature_prominence: Positive | None = unit("temperature_prominence_K", None)

    @field_validator("adc_max")
    @classmethod
    def _adc_range(cls, value: float, info: ValidationInfo) -> float:
        return above(info, value, "adc_min", "adc_min")
