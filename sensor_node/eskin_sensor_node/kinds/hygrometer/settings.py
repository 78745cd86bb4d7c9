"""Settings of a capacitive polymer that measures the humidity."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from eskin_sensor_node.firmware.taxel.hygrometer import HygrometerTaxel
from eskin_sensor_node.kinds.rc import RcSection
from eskin_sensor_node.kinds.settings import Positive, Rate, Tolerance, unit
from eskin_sensor_node.world.scenario.fit import Played


class HygrometerSection(Played, RcSection):
    """Polymer whose capacitance is linear in the humidity. Noise: in A, before the ADC."""

    firmware: ClassVar[type[HygrometerTaxel]] = HygrometerTaxel

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
