"""Pressed pads of a skin: two plates with an elastic layer between them.

Under a contact of pressure p the layer is compressed to ``d = d0 / (1 + p/E)``: it hardens as it
gets thinner and never vanishes; E halves it. A contact that covers the share s of the plate A then
gives ``C = ε·A·[(1-s)/d0 + s/d] = C0·(1 + P/E)`` with the mean pressure ``P = s·p``: the
capacitance is linear in it (eq. 2, 9 and 10 of the paper at once), and the plates' mean distance
(harmonic over the plate) is ``d0 / (1 + P/E)``.

An actuator that moves the plates apart does so by what lies between them: it swells, and keeps its
law. So d0 is what stands between the plates at rest, wherever the actuator stands.

The permittivity follows the surroundings: ``ε = ε0·εr·[1 + a·(T - 20 °C) + b·(H - 50 %)]``.

A pad that wears has another d0 and another E; water on it adds a share of C0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Final, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from eskin_sensor_node.firmware.inversion.hygrometer import REFERENCE_HUMIDITY
from eskin_sensor_node.firmware.inversion.pad import REFERENCE_TEMPERATURE
from eskin_sensor_node.firmware.taxel.pad import PadTaxel
from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.parameters import TRUE_VACUUM_PERMITTIVITY, at_step, draw_part
from eskin_sensor_node.kinds.plates import Actuated, draw_actuator
from eskin_sensor_node.kinds.rc import CapacitanceSection, RcFrontend
from eskin_sensor_node.kinds.settings import ContactPlace, Positive, Tolerance, unit
from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.world.scenario import Stage, read_scenario
from eskin_sensor_node.world.scenario.fit import (
    Staged,
    require_air,
    require_crosstalk,
    require_pressure,
    require_room,
    require_sound,
)
from eskin_sensor_node.world.skin import break_off, placed, wet, worn

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.world.scenario import Stimulus


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


_OPEN_LINE: Final = 1e-18
"""Capacitance in F of a line that is broken at the oscillator."""


class PadParts(NamedTuple):
    """True parts of some pads, each a column.

    Attributes:
        area: Of the plates, m².
        permittivity: Relative, at rest.
        distance: Of the plates at rest, m.
        elasticity: In Pa.
        per_kelvin: Relative change of the permittivity for each K.
        per_percent: The same for each percent of humidity.
    """

    area: Floats
    permittivity: Floats
    distance: Floats
    elasticity: Floats
    per_kelvin: Floats
    per_percent: Floats


class PadWorld(World):
    """Pads of a skin.

    Args:
        taxel: Their data sheet.
        random: Draws a column of a part at once.
        places: Where they are in their skin: pads of one node, or all at one place, in many nodes.
        stage: Plays their scenario for them; ``None``: as the data sheet has it.
    """

    def __init__(
        self,
        taxel: PadSection,
        random: ColumnGenerator,
        places: Sequence[str],
        *,
        stage: Stage | None = None,
    ) -> None:
        script = read_scenario(taxel.scenario)
        self._parts = parts = _draw(taxel, random)
        self._charge = TRUE_VACUUM_PERMITTIVITY * parts.permittivity * parts.area
        self._apart = draw_actuator(taxel, random)
        self.move(0)
        self._faults = placed(script.fault, places)
        self._wear = placed(script.wear, places)
        self._films = placed(script.film, places)
        self._stuck: dict[float, Floats] = {}
        self._stage = stage or Stage(script, list(dict.fromkeys(places)))

    def move(self, steps: ArrayLike) -> None:
        """Move the plates."""
        self._moved = at_step(self._apart, steps)

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """Truth as `truth` has it.

        The air is sensed, too: temperature in °C, humidity in %.
        """
        del random
        truth, stimulus = self.truth(seconds)
        air = {"temperature": stimulus.temperature, "humidity": stimulus.humidity}
        return Signals(truth, {"capacitance": truth["capacitance"]} | air)

    def truth(self, seconds: Floats) -> tuple[dict[str, Floats], Stimulus]:
        """What is at some times, each quantity an array of columns × times, and what caused it.

        Returns:
            Capacitance at the oscillator in F (with crosstalk and faults), contact area in m², mean
            plate distance in m (harmonic over the plate, with crosstalk) and the one under the
            contact, mean pressure of the contacts in Pa.
        """
        stimulus = self._stage.stimulus(seconds)
        capacitance = self._capacitance(stimulus, seconds)
        if self._faults:
            break_off(
                capacitance,
                seconds,
                self._faults,
                intact=self._kept,
                dead=_OPEN_LINE,
            )
        covered = stimulus.covered
        touched = covered > 0.0
        local = np.where(touched, stimulus.pressure / np.where(touched, covered, 1.0), 0.0)
        distance, elasticity = self._layer(stimulus, seconds)
        truth = {
            "capacitance": capacitance,
            "contact_area": covered * self._parts.area,
            "plate_distance": distance / (1.0 + stimulus.felt / elasticity),
            "contact_distance": distance / (1.0 + local / elasticity),
            "pressure": stimulus.pressure,
        }
        return truth, stimulus

    def _kept(self, then: Floats) -> Floats:
        """What stuck taxels keep, from before their plates moved on."""
        instant = float(then[0])
        if instant not in self._stuck:
            self._stuck[instant] = self._capacitance(self._stage.stimulus(then), then)
        return self._stuck[instant]

    def _layer(self, stimulus: Stimulus, seconds: Floats) -> tuple[Floats, Floats]:
        """Distance at rest and elasticity of the layer, as far as they are worn."""
        shape = np.broadcast_shapes(stimulus.felt.shape, self._parts.area.shape)
        distance = self._parts.distance * worn(self._wear, "distance_per_s", shape, seconds)
        elasticity = self._parts.elasticity * worn(self._wear, "elasticity_per_s", shape, seconds)
        return distance + self._moved, elasticity

    def _capacitance(self, stimulus: Stimulus, seconds: Floats) -> Floats:
        ambient = (
            1.0
            + self._parts.per_kelvin * (stimulus.temperature - REFERENCE_TEMPERATURE)
            + self._parts.per_percent * (stimulus.humidity - REFERENCE_HUMIDITY)
        )
        distance, elasticity = self._layer(stimulus, seconds)
        strain = stimulus.felt / elasticity
        water = wet(self._films, np.broadcast_shapes(strain.shape, distance.shape), seconds)
        return np.asarray(self._charge / distance * (ambient * (1.0 + strain) + water))


def _draw(taxel: PadSection, random: ColumnGenerator) -> PadParts:
    sheet = (
        (taxel.plate_area_m2, taxel.plate_area_tolerance),
        (taxel.relative_permittivity, taxel.relative_permittivity_tolerance),
        (taxel.plate_distance_m, taxel.plate_distance_tolerance),
        (taxel.elasticity_Pa, taxel.elasticity_tolerance),
        (taxel.permittivity_per_K, taxel.permittivity_per_K_tolerance),
        (taxel.permittivity_per_percent, taxel.permittivity_per_percent_tolerance),
    )
    return PadParts(*(draw_part(random, *each) for each in sheet))


PAD = Kind(settings=PadSection, world=PadWorld, frontend=RcFrontend)
