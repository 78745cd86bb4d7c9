"""A metal object before a coil (eq. 11 and 13 of the paper)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.physics.parameters import draw_part
from eskin_sensor_node.physics.signals import Signals

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_sensor_node.taxels import SwingSection


class InductiveWorld:
    """``L = L0 - ΔL·e^(-alpha·d)`` over a distance that swings harmonically."""

    def __init__(self, taxel: SwingSection, random: np.random.Generator) -> None:
        self._base = draw_part(random, taxel.inductance, taxel.inductance_tolerance)
        self._change = draw_part(random, taxel.inductance_change, taxel.inductance_change_tolerance)
        self._damping = draw_part(random, taxel.damping_per_m, taxel.damping_tolerance)
        self._mid = taxel.distance_mid_m
        self._amplitude = taxel.distance_amplitude_m
        self._stimulus = taxel.stimulus

    def signals(self, seconds: Floats, random: np.random.Generator) -> Signals:
        """True distance in m and inductance in H."""
        del random
        swing = np.sin(2.0 * np.pi * self._stimulus * seconds)
        distance = self._mid + self._amplitude * swing
        inductance = self._base - self._change * np.exp(-self._damping * distance)
        truth = {"inductance": inductance, "distance": distance}
        return Signals(truth, truth)
