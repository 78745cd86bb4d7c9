"""A capacitance that is forced harmonically (eq. 5 of the paper)."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import ValidationInfo, field_validator

from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.parameters import draw_part
from eskin_sensor_node.kinds.rc import CapacitanceSection, RcFrontend
from eskin_sensor_node.kinds.recorded import RecordedWorld
from eskin_sensor_node.kinds.settings import Positive, Tolerance, above, unit
from eskin_sensor_node.kinds.signals import Signals, World, raised_sine
from eskin_sensor_node.world.replay import Recorded

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator


class CapacitiveSection(CapacitanceSection):
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


class RecordedCapacitanceSection(Recorded, CapacitanceSection):
    """Capacitance out of a recording, behind the chain of Fig. 3. Noise: in A, before the ADC."""

    kind: Literal["recorded_capacitance"]


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


CAPACITIVE = Kind(settings=CapacitiveSection, world=CapacitiveWorld, frontend=RcFrontend)
RECORDED_CAPACITANCE = Kind(
    settings=RecordedCapacitanceSection, world=RecordedCapacitanceWorld, frontend=RcFrontend
)
