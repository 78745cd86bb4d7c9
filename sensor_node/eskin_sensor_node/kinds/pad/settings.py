"""Settings of a pressed pad of a skin."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from eskin_sensor_node.firmware.taxel.pad import PadTaxel
from eskin_sensor_node.kinds.plates import Actuated
from eskin_sensor_node.kinds.rc import CapacitanceSection
from eskin_sensor_node.kinds.settings import ContactPlace, Positive, Tolerance, unit
from eskin_sensor_node.world.scenario.fit import (
    Staged,
    require_air,
    require_crosstalk,
    require_pressure,
    require_room,
    require_sound,
)


class PadSection(Staged, Actuated, CapacitanceSection):
    """Capacitive taxel of a skin, pressed as a scenario has it. Noise: in A, before the ADC.

    Two plates with an elastic layer between them; docs/scenarios.md has its model.
    """

    firmware: ClassVar[type[PadTaxel]] = PadTaxel
    pressed: ClassVar[bool] = True

    kind: Literal["pad"]
    plate_area_m2: Positive
    plate_area_tolerance: Tolerance = 1e-3
    plate_distance_m: Positive = Field(default=1e-3, description="at rest")
    plate_distance_tolerance: Tolerance = 1e-3
    relative_permittivity: float = Field(default=3.0, ge=1, description="at 20 °C and 50 %")
    relative_permittivity_tolerance: Tolerance = 1e-3
    permittivity_per_K: float = Field(default=1e-3, ge=-0.01, le=0.01, description="relative")
    permittivity_per_K_tolerance: Tolerance = 0.05
    permittivity_per_percent: float = Field(default=5e-4, ge=-5e-3, le=5e-3, description="relative")
    permittivity_per_percent_tolerance: Tolerance = 0.05
    elasticity_Pa: Positive = Field(default=1e5, description="pressure that halves the distance")
    elasticity_tolerance: Tolerance = 0.02
    pressure_max_Pa: Positive = Field(default=5e4, description="greatest pressure of a contact")
    contact_pressure: Positive = unit(
        "contact_pressure_Pa", 3e3, description="from which on there is a contact"
    )
    crosstalk: float = Field(
        default=0.1, ge=0, le=0.5, description="share of its neighbours' pressure that it feels"
    )
    doubtful_neighbours: int = Field(
        default=1,
        ge=0,
        le=8,
        description="how many of its neighbours may be stuck without the node's knowledge",
    )
    thermometer: str | None = Field(
        default=None, description="id of the node's taxel that it reads the temperature from"
    )
    hygrometer: str | None = Field(
        default=None, description="id of the node's taxel that it reads the humidity from"
    )
    temperature_min: float = unit("temperature_min_Cel", 0.0, description="without thermometer")
    temperature_max: float = unit("temperature_max_Cel", 50.0, description="without thermometer")
    humidity_min: float = unit("humidity_min_percent", 0.0, description="without hygrometer")
    humidity_max: float = unit("humidity_max_percent", 100.0, description="without hygrometer")
    plate_distance_prominence: Positive | None = unit("plate_distance_prominence_m", None)
    contact_area_prominence: Positive | None = unit("contact_area_prominence_m2", None)
    pressure_prominence: Positive | None = unit("pressure_prominence_Pa", None)

    @property
    def companions(self) -> dict[str, str]:
        """What it reads along, at its own instants, to the id of that taxel of its node."""
        named = {"thermometer": self.thermometer, "hygrometer": self.hygrometer}
        return {role: name for role, name in named.items() if name is not None}

    def contact_of(self, quantity: str) -> ContactPlace | None:
        """Where on a skin a quantity shows contacts; ``None`` if it does not."""
        if quantity != "pressure":
            return None
        return ContactPlace(self.scenario, self.contact_pressure, self.place)

    @model_validator(mode="after")
    def _fits_the_scenario(self) -> Self:
        require_pressure(self.scenario, self.pressure_max_Pa)
        require_room(self.scenario, self.plate_area_m2)
        require_crosstalk(self.scenario, self.crosstalk)
        require_sound(self.scenario, self.place, self.doubtful_neighbours)
        require_air(
            self.scenario,
            (self.temperature_min, self.temperature_max),
            (self.humidity_min, self.humidity_max),
        )
        return self
