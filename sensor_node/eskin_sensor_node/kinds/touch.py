"""A touch that covers more or less of a plate (eq. 2 and 10 of the paper)."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Final, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from eskin_sensor_node.firmware.taxel.touch import TouchTaxel
from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.parameters import (
    TRUE_VACUUM_PERMITTIVITY,
    at_step,
    draw_noise,
    draw_part,
)
from eskin_sensor_node.kinds.plates import Actuated, draw_actuator
from eskin_sensor_node.kinds.rc import RcFrontend, RcSection
from eskin_sensor_node.kinds.settings import Positive, Tolerance, above, unit
from eskin_sensor_node.kinds.signals import Signals, World, raised_sine

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator


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


_LEAST_AREA: Final = 1e-12
"""In m²: noise never makes a plate's area vanish or negative for the oscillator."""


class TouchWorld(World):
    """Covered area, capacitance and stored energy ½CV²; noise falls on the area."""

    def __init__(self, taxel: TouchSection, random: ColumnGenerator) -> None:
        self._least = draw_part(random, taxel.area_min_m2, taxel.area_tolerance)
        self._most = draw_part(random, taxel.area_max_m2, taxel.area_tolerance)
        self._distance = draw_part(random, taxel.plate_distance_m, taxel.plate_distance_tolerance)
        self._supply = draw_part(random, taxel.supply, taxel.supply_tolerance)
        self._permittivity = TRUE_VACUUM_PERMITTIVITY * draw_part(
            random, taxel.relative_permittivity, taxel.relative_permittivity_tolerance
        )
        self._stimulus = taxel.stimulus
        self._noise = taxel.noise
        self._apart = draw_actuator(taxel, random)
        self.move(0)

    def move(self, steps: ArrayLike) -> None:
        """Move the plates."""
        self._moved = self._distance + at_step(self._apart, steps)

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """True area in m², capacitance in F, energy in J; the chain senses a noisy capacitance."""
        share = raised_sine(seconds, self._stimulus)
        area = (1.0 - share) * self._least + share * self._most
        noisy = np.maximum(area + draw_noise(random, self._noise), _LEAST_AREA)
        capacitance = self._capacitance(area)
        energy = 0.5 * capacitance * (self._supply * self._supply)
        return Signals(
            truth={"area": area, "capacitance": capacitance, "energy": energy},
            sensed={"capacitance": self._capacitance(noisy)},
        )

    def _capacitance(self, area: Floats) -> Floats:
        return np.asarray(self._permittivity * area / self._moved)


class TouchFrontend(RcFrontend):
    """The chain of Fig. 3, without noise: the touch is disturbed at the plate, not behind it."""

    def __init__(self, taxel: TouchSection, random: ColumnGenerator) -> None:
        super().__init__(taxel, random)
        self._noise = None


TOUCH = Kind(settings=TouchSection, world=TouchWorld, frontend=TouchFrontend)
