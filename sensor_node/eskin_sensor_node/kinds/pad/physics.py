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

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin_sensor_node.firmware.inversion.hygrometer import REFERENCE_HUMIDITY
from eskin_sensor_node.firmware.inversion.pad import REFERENCE_TEMPERATURE
from eskin_sensor_node.kinds.parameters import TRUE_VACUUM_PERMITTIVITY, at_step, draw_part
from eskin_sensor_node.kinds.plates import draw_actuator
from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.world.scenario import Stage, read_scenario
from eskin_sensor_node.world.skin import break_off, placed, wet, worn

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.pad.settings import PadSection
    from eskin_sensor_node.world.scenario import Stimulus

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
        moment = float(then[0])
        if moment not in self._stuck:
            self._stuck[moment] = self._capacitance(self._stage.stimulus(then), then)
        return self._stuck[moment]

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
