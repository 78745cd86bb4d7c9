"""Taxels whose capacitance is measured: the chain of Fig. 3."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from eskin.runtime.settings import Section
from eskin_sensor_node.taxels.settings import Positive, Rate, TaxelSection, Tolerance, above, unit
from eskin_sensor_node.world.replay import Recorded
from eskin_sensor_node.world.scenario.fit import (
    Staged,
    require_air,
    require_crosstalk,
    require_pressure,
    require_room,
    require_sound,
)


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


class Actuated(Section):
    """Plates that an actuator moves apart."""

    actuator_steps: int = Field(
        default=0, ge=0, le=100, description="steps by which the plates can be moved apart"
    )
    actuator_step_m: Positive = Field(default=2.5e-4, description="size of one, at rest")
    actuator_step_tolerance: Tolerance = Field(default=2e-3, description="of what a step adds")


class CapacitiveSection(RcSection):
    """What all taxels have whose capacitance is measured (eq. 6). Noise: in A, before the ADC."""

    chain: ClassVar[str] = "capacitive"
    units: ClassVar[dict[str, str]] = {"capacitance": "F", "current": "A"}

    capacitance_prominence: Positive | None = unit("capacitance_prominence_F", None)
    current_prominence: Positive | None = unit("current_prominence_A", None)


class HarmonicSection(CapacitiveSection):
    """Capacitive taxel under a harmonic stimulus (eq. 5, 6). Noise: in A, before the ADC."""

    kind: Literal["capacitive"]
    capacitance_min: Positive = unit("capacitance_min_F")
    capacitance_max: Positive = unit("capacitance_max_F")
    capacitance_tolerance: Tolerance = 0.02
    stimulus: Positive = unit("stimulus_Hz", 2.0)

    @field_validator("capacitance_max")
    @classmethod
    def _capacitance_range(cls, value: float, info: ValidationInfo) -> float:
        return above(info, value, "capacitance_min_F", "capacitance_min")


class RecordedCapacitanceSection(Recorded, CapacitiveSection):
    """Capacitance out of a recording, behind the chain of Fig. 3. Noise: in A, before the ADC."""

    kind: Literal["recorded_capacitance"]


class PadSection(Staged, Actuated, CapacitiveSection):
    """Capacitive taxel of a skin, pressed as a scenario has it. Noise: in A, before the ADC.

    Two plates with an elastic layer between them; docs/scenarios.md has its model.
    """

    chain: ClassVar[str] = "pad"
    units: ClassVar[dict[str, str]] = {
        **CapacitiveSection.units,
        "plate_distance": "m",
        "contact_area": "m2",
        "pressure": "Pa",
    }

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


class TouchSection(Actuated, RcSection):
    """Touch that covers a plate (eq. 2, 10). Noise: on the area, in m²."""

    chain: ClassVar[str] = "touch"
    units: ClassVar[dict[str, str]] = {"area": "m2", "capacitance": "F", "energy": "J"}

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
