"""Settings of the ICM hybrid (eq. 26, 27)."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from eskin_sensor_node.firmware.taxel.hybrid import HybridTaxel
from eskin_sensor_node.kinds.settings import Positive, Rate, TaxelSection, Tolerance, above, unit


class HybridSection(TaxelSection):
    """ICM: MagFES current and EcFES voltage after switching on (eq. 26, 27), in bursts.

    Noise: in V, before the bipolar ADC.
    """

    firmware: ClassVar[type[HybridTaxel]] = HybridTaxel

    kind: Literal["hybrid"]
    sampling: Rate = unit("sampling_Hz", 100e3)
    burst_s: float = Field(default=0.04, gt=0)
    burst_period_s: float = Field(default=1.0, gt=0)
    amplitude: Positive = unit("amplitude_V", 5.0)
    supply: Positive = unit("supply_Hz", 50.0)
    phase_deg: float = Field(default=-46.0, ge=-180, le=180)
    coil_resistance_ohm: Positive = 10e3
    coil_inductance: Positive = unit("coil_inductance_H", 1e-3)
    capacitor_resistance_ohm: Positive = 2419.0
    capacitance: Positive = unit("capacitance_F", 1e-6)
    part_tolerance: Tolerance = 0.01
    current_gain: Positive = unit("current_gain_V_per_A", 2000.0)
    current_gain_tolerance: Tolerance = 1e-3
    voltage_gain: Positive = unit("voltage_gain_V_per_V", 0.25)
    voltage_gain_tolerance: Tolerance = 1e-3
    adc_max: Positive = unit("adc_max_V", 1.25)
    current_prominence: Positive | None = unit("current_prominence_A", None)
    voltage_prominence: Positive | None = unit("voltage_prominence_V", None)

    @property
    def adc_min(self) -> float:
        """Lower end of the range, in V: the converter is bipolar."""
        return -self.adc_max

    @property
    def burst(self) -> tuple[float, float]:
        """Length and period in s of its bursts."""
        return self.burst_s, self.burst_period_s

    @field_validator("burst_period_s")
    @classmethod
    def _bursts_do_not_overlap(cls, value: float, info: ValidationInfo) -> float:
        return above(info, value, "burst_s", "burst_s")
