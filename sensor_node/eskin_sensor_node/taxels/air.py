"""Taxels that measure the air of a scenario."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from eskin_sensor_node.taxels.capacitive import RcSection
from eskin_sensor_node.taxels.settings import Positive, Rate, TaxelSection, Tolerance, above, unit
from eskin_sensor_node.world.scenario.fit import Played


class ThermometerSection(Played, TaxelSection):
    """Platinum resistor in a divider (IEC 60751). Noise: as a share of the supply, before the ADC.

    The divider's supply is the converter's reference, too, so that it cancels.
    """

    chain: ClassVar[str] = "thermometer"
    units: ClassVar[dict[str, str]] = {"temperature": "Cel"}

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


class HygrometerSection(Played, RcSection):
    """Polymer whose capacitance is linear in the humidity. Noise: in A, before the ADC."""

    chain: ClassVar[str] = "hygrometer"
    units: ClassVar[dict[str, str]] = {"humidity": "%"}

    kind: Literal["hygrometer"]
    sampling: Rate = unit("sampling_Hz", 50.0)
    reference: Positive = unit("reference_Hz", 1e6)
    adc_min: float = unit("adc_min_A", 0.75e-3, ge=0)
    capacitance: Positive = unit("capacitance_F", 180e-12, description="at 50 %")
    capacitance_tolerance: Tolerance = 1e-3
    sensitivity: float = unit(
        "sensitivity_per_percent", 1.8e-3, gt=0, le=0.01, description="relative"
    )
    sensitivity_tolerance: Tolerance = 0.01
    error_percent: float = Field(
        default=2.0, ge=0, le=20, description="greatest deviation from the straight line"
    )
    humidity_prominence: Positive | None = unit("humidity_prominence_percent", None)
