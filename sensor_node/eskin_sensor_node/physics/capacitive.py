"""A capacitance that is forced harmonically (eq. 5 of the paper)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.physics.parameters import draw_part
from eskin_sensor_node.physics.signals import Signals, raised_sine

if TYPE_CHECKING:
    import numpy as np

    from eskin.interval import Floats
    from eskin_sensor_node.taxels import HarmonicSection


class CapacitiveWorld:
    """``C = (1-s)·Cmin + s·Cmax`` with the raised sine s."""

    def __init__(self, taxel: HarmonicSection, random: np.random.Generator) -> None:
        tolerance = taxel.capacitance_tolerance
        self._least = draw_part(random, taxel.capacitance_min, tolerance)
        self._most = draw_part(random, taxel.capacitance_max, tolerance)
        self._stimulus = taxel.stimulus

    def signals(self, seconds: Floats, random: np.random.Generator) -> Signals:
        """True capacitance in F."""
        del random
        share = raised_sine(seconds, self._stimulus)
        truth = {"capacitance": (1.0 - share) * self._least + share * self._most}
        return Signals(truth, truth)
