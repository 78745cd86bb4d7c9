"""Settings of a touch that covers a plate."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from eskin_sensor_node.firmware.taxel.touch import TouchTaxel
from eskin_sensor_node.kinds.plates import Actuated
from eskin_sensor_node.kinds.rc import RcSection
from eskin_sensor_node.kinds.settings import Positive, Tolerance, above, unit


class TouchSection(Actuated, RcSection):
    """Touch that covers a plate (eq. 2, 10). Noise: on the area, in m²."""

    firmware: ClassVar[type[TouchTaxel]] = TouchTaxel

    kind: Literal["touch"]
    area_min_m2: Positive = 1e-5
    area_max_m2: Positive = 1e-4
    area_tolerance: Tolerance = 0.02
    plate_distance_m: Positive = 1e-3
    plate_distance_tolerance: Tolerance = 2e-3
    relative_permittivity: float = Field(default=1.0, ge=1)
    relative_permittivity_tolerance: Tolerance = Field(
        default=1e-3, description="the default holds air, 1.0006"
    )
    supply: Positive = unit("supply_V", 5.0)
    supply_tolerance: Tolerance = 1e-3
    stimulus: Positive = unit("stimulus_Hz", 0.8)
    area_prominence: Positive | None = unit("area_prominence_m2", None)
    capacitance_prominence: Positive | None = unit("capacitance_prominence_F", None)
    energy_prominence: Positive | None = unit("energy_prominence_J", None)

    @field_validator("area_max_m2")
    @classmethod
    def _area_range(cls, value: float, info: ValidationInfo) -> float:
        return above(info, value, "area_min_m2", "area_min_m2")
