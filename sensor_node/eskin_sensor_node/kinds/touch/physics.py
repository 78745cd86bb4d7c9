"""A touch that covers more or less of a plate (eq. 2 and 10 of the paper)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin_sensor_node.kinds.parameters import (
    TRUE_VACUUM_PERMITTIVITY,
    at_step,
    draw_noise,
    draw_part,
)
from eskin_sensor_node.kinds.plates import draw_actuator
from eskin_sensor_node.kinds.signals import Signals, World, raised_sine

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.touch.settings import TouchSection

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
