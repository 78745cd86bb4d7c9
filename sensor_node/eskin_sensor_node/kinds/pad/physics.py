"""Pressed pads of a skin: two plates with an elastic layer between them.

Under a contact of pressure p the layer is compressed to ``d = d0 / (1 + p/E)``: it hardens as it
gets thinner and never vanishes; E halves it. A contact that covers the share s of the plate A then
gives ``C = ε·A·[(1-s)/d0 + s/d] = C0·(1 + P/E)`` with the mean pressure ``P = s·p``: the
capacitance is linear in it (eq. 2, 9 and 10 of the paper at once), and the plates' mean distance
(harmonic over the plate) is ``d0 / (1 + P/E)``.

An actuator that moves the plates apart does so by what lies between them: it swells, and keeps its
law. So d0 is what stands between the plates at rest, wherever the actuator stands.

The permittivity follows the surroundings: ``ε = ε0·εr·[1 + a·(T - 20 °C) + b·(H - 50 %)]``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from eskin_sensor_node.firmware.inversion.hygrometer import REFERENCE_HUMIDITY
from eskin_sensor_node.firmware.inversion.pad import REFERENCE_TEMPERATURE
from eskin_sensor_node.kinds.parameters import TRUE_VACUUM_PERMITTIVITY, draw_part
from eskin_sensor_node.kinds.plates import draw_actuator
from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.world.scenario import Stage, read_scenario
from eskin_sensor_node.world.skin import break_off

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.pad.settings import PadSection
    from eskin_sensor_node.world.scenario import Stimulus
    from eskin_sensor_node.world.skin import FaultSection

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


class Pads:
    """Some pads with their true parts, each a row of an array.

    Args:
        parts: Theirs.
        apart: By how much each step of a pad's actuator takes its plates apart, steps × pads × 1.
        places: Where they are in their skin.
        stage: Plays their scenario for them, in this order.
        faults: Those of the scenario.
    """

    def __init__(
        self,
        parts: PadParts,
        apart: Floats,
        places: Sequence[str],
        *,
        stage: Stage,
        faults: Sequence[FaultSection],
    ) -> None:
        self._parts = parts
        self._charge = TRUE_VACUUM_PERMITTIVITY * parts.permittivity * parts.area
        self._apart = apart
        self.move(0)
        rows = {place: row for row, place in enumerate(places)}
        self._faults = [(rows[fault.taxel], fault) for fault in faults if fault.taxel in rows]
        self._stuck: dict[float, Floats] = {}
        self._stage = stage

    @classmethod
    def draw(
        cls,
        taxels: Sequence[PadSection],
        randoms: Sequence[np.random.Generator],
        *,
        stage: Stage,
        faults: Sequence[FaultSection],
    ) -> Self:
        """Draw the true parts of some pads, each with its own data sheet and generator."""
        parts, apart = [], []
        for taxel, random in zip(taxels, randoms, strict=True):
            standing = _draw(taxel, random)
            apart.append(draw_actuator(taxel, random))
            parts.append((*standing, *_draw_slopes(taxel, random)))
        columns = PadParts(*np.array(parts).T[:, :, None])
        places = [taxel.place for taxel in taxels]
        return cls(columns, np.array(apart).T[:, :, None], places, stage=stage, faults=faults)

    def move(self, steps: int) -> None:
        """Move the plates of all to one of their actuators' steps."""
        self._distance = self._parts.distance + self._apart[steps]

    def truth(self, seconds: Floats) -> tuple[dict[str, Floats], Stimulus]:
        """What is at some times, each quantity an array of pads × times, and what caused it.

        Returns:
            Capacitance at the oscillator in F (with crosstalk and faults), contact area in m², mean
            plate distance in m (harmonic over the plate, with crosstalk) and the one under the
            contact, mean pressure of the contacts in Pa.
        """
        capacitance, stimulus = self.capacitance(seconds)
        covered = stimulus.covered
        touched = covered > 0.0
        local = np.where(touched, stimulus.pressure / np.where(touched, covered, 1.0), 0.0)
        elasticity = self._parts.elasticity
        truth = {
            "capacitance": capacitance,
            "contact_area": covered * self._parts.area,
            "plate_distance": self._distance / (1.0 + stimulus.felt / elasticity),
            "contact_distance": self._distance / (1.0 + local / elasticity),
            "pressure": stimulus.pressure,
        }
        return truth, stimulus

    def capacitance(self, seconds: Floats) -> tuple[Floats, Stimulus]:
        """At the oscillator in F, pads × times, with crosstalk and faults; and what caused it."""
        stimulus = self._stage.stimulus(seconds)
        capacitance = self._capacitance(stimulus)
        if self._faults:
            break_off(
                capacitance,
                seconds,
                self._faults,
                intact=self._kept,
                dead=_OPEN_LINE,
            )
        return capacitance, stimulus

    def _kept(self, then: Floats) -> Floats:
        """What stuck taxels keep, from before their plates moved on."""
        moment = float(then[0])
        if moment not in self._stuck:
            self._stuck[moment] = self._capacitance(self._stage.stimulus(then))
        return self._stuck[moment]

    def _capacitance(self, stimulus: Stimulus) -> Floats:
        ambient = (
            1.0
            + self._parts.per_kelvin * (stimulus.temperature - REFERENCE_TEMPERATURE)
            + self._parts.per_percent * (stimulus.humidity - REFERENCE_HUMIDITY)
        )
        rest = self._charge / self._distance
        return np.asarray(rest * ambient * (1.0 + stimulus.felt / self._parts.elasticity))


class PadWorld(World):
    """One pad of a node."""

    def __init__(self, taxel: PadSection, random: np.random.Generator) -> None:
        script = read_scenario(taxel.scenario)
        stage = Stage(script, [taxel.place])
        self._pads = Pads.draw([taxel], [random], stage=stage, faults=script.fault)

    def move(self, steps: int) -> None:
        """Move the plates to one of their actuator's steps."""
        self._pads.move(steps)

    def signals(self, seconds: Floats, random: np.random.Generator) -> Signals:
        """True capacitance in F, contact area in m², distances in m, pressure in Pa.

        The air is sensed, too: temperature in °C, humidity in %.
        """
        del random
        true, stimulus = self._pads.truth(seconds)
        truth = {name: values[0] for name, values in true.items()}
        air = {"temperature": stimulus.temperature, "humidity": stimulus.humidity}
        return Signals(truth, truth | air)


class PadSkinWorld(World):
    """Many pads of a skin with one data sheet, a column each; their plates do not move.

    Args:
        taxel: The data sheet.
        random: Draws a column of a part at once.
        places: Where they are.
    """

    def __init__(
        self, taxel: PadSection, random: np.random.Generator, places: Sequence[str]
    ) -> None:
        script = read_scenario(taxel.scenario)
        parts = PadParts(*_draw(taxel, random), *_draw_slopes(taxel, random))  # type: ignore[arg-type]  # columns
        unmoved = np.zeros((1, len(places), 1))
        stage = Stage(script, places)
        self._pads = Pads(parts, unmoved, places, stage=stage, faults=script.fault)

    def signals(self, seconds: Floats, random: np.random.Generator) -> Signals:
        """True pressure in Pa; sensed are capacitance in F, and the air; pads × times."""
        del random
        capacitance, stimulus = self._pads.capacitance(seconds)
        air = {"temperature": stimulus.temperature, "humidity": stimulus.humidity}
        return Signals({"pressure": stimulus.pressure}, {"capacitance": capacitance} | air)


def _draw_slopes(taxel: PadSection, random: np.random.Generator) -> tuple[float, float]:
    """Relative change of the permittivity for each K and each percent of humidity."""
    per_percent = taxel.permittivity_per_percent, taxel.permittivity_per_percent_tolerance
    return (
        draw_part(random, taxel.permittivity_per_K, taxel.permittivity_per_K_tolerance),
        draw_part(random, *per_percent),
    )


def _draw(taxel: PadSection, random: np.random.Generator) -> tuple[float, float, float, float]:
    """Plate area, relative permittivity, plate distance at rest, elasticity."""
    return (
        draw_part(random, taxel.plate_area_m2, taxel.plate_area_tolerance),
        draw_part(random, taxel.relative_permittivity, taxel.relative_permittivity_tolerance),
        draw_part(random, taxel.plate_distance_m, taxel.plate_distance_tolerance),
        draw_part(random, taxel.elasticity_Pa, taxel.elasticity_tolerance),
    )
