"""A capacitance that is forced harmonically (eq. 5 of the paper)."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from eskin_sensor_node.kinds.parameters import draw_part
from eskin_sensor_node.kinds.recorded import RecordedWorld
from eskin_sensor_node.kinds.signals import Signals, World, raised_sine

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_sensor_node.kinds.capacitive.settings import CapacitiveSection
    from eskin_sensor_node.kinds.generator import ColumnGenerator


class CapacitiveWorld(World):
    """``C = (1-s)·Cmin + s·Cmax`` with the raised sine s."""

    def __init__(self, taxel: CapacitiveSection, random: ColumnGenerator) -> None:
        tolerance = taxel.capacitance_tolerance
        self._least = draw_part(random, taxel.capacitance_min, tolerance)
        self._most = draw_part(random, taxel.capacitance_max, tolerance)
        self._stimulus = taxel.stimulus

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """True capacitance in F."""
        del random
        share = raised_sine(seconds, self._stimulus)
        truth = {"capacitance": (1.0 - share) * self._least + share * self._most}
        return Signals(truth, truth)


class RecordedCapacitanceWorld(RecordedWorld):
    """A capacitance out of a recording."""

    quantity: ClassVar[str] = "capacitance"
