"""A metal object before a coil (eq. 11 and 13 of the paper)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.lc import LcFrontend, LcSection
from eskin_sensor_node.kinds.parameters import draw_part
from eskin_sensor_node.kinds.recorded import RecordedWorld
from eskin_sensor_node.kinds.settings import Positive, above, unit
from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.world.replay import Recorded

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator


class InductiveSection(LcSection):
    """Metal whose distance swings harmonically (eq. 11 to 13). Noise: in V, before the ADC."""

    kind: Literal["inductive"]
    distance_amplitude_m: Annotated[float, Field(ge=0)] = 0.01
    distance_mid_m: Positive = 0.02
    stimulus: Positive = unit("stimulus_Hz", 1.0)

    @field_validator("distance_mid_m")
    @classmethod
    def _in_front_of_the_coil(cls, value: float, info: ValidationInfo) -> float:
        return above(info, value, "distance_amplitude_m", "distance_amplitude_m")


class RecordedInductanceSection(Recorded, LcSection):
    """Inductance out of a recording, behind the chain of a coil. Noise: in V, before the ADC."""

    kind: Literal["recorded_inductance"]


_LEAST_SHARE: Final = 1e-18
"""Of the greatest change of the inductance, where metal is as far as can be."""


class InductiveWorld(World):
    """``L = L0 - ΔL·e^(-alpha·d)`` over a distance that swings harmonically."""

    def __init__(self, taxel: InductiveSection, random: ColumnGenerator) -> None:
        self._base = draw_part(random, taxel.inductance, taxel.inductance_tolerance)
        self._change = draw_part(random, taxel.inductance_change, taxel.inductance_change_tolerance)
        self._damping = draw_part(random, taxel.damping_per_m, taxel.damping_tolerance)
        self._mid = taxel.distance_mid_m
        self._amplitude = taxel.distance_amplitude_m
        self._stimulus = taxel.stimulus

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """True distance in m and inductance in H."""
        del random
        swing = np.sin(2.0 * np.pi * self._stimulus * seconds)
        distance = self._mid + self._amplitude * swing
        inductance = self._base - self._change * np.exp(-self._damping * distance)
        truth = {"inductance": inductance, "distance": distance}
        return Signals(truth, truth)


class RecordedInductanceWorld(RecordedWorld):
    """An inductance out of a recording, taken for a coil before which metal moves (eq. 11)."""

    quantity: ClassVar[str] = "inductance"

    def __init__(self, taxel: RecordedInductanceSection, random: ColumnGenerator) -> None:
        super().__init__(taxel, random)
        self._base = draw_part(random, taxel.inductance, taxel.inductance_tolerance)
        self._change = draw_part(random, taxel.inductance_change, taxel.inductance_change_tolerance)
        self._damping = draw_part(random, taxel.damping_per_m, taxel.damping_tolerance)

    def truth(self, value: Floats) -> dict[str, Floats]:
        """Inductance, and distance of the metal in m: the nearest or farthest where none fits."""
        share = np.clip((self._base - value) / self._change, _LEAST_SHARE, 1.0)
        return super().truth(value) | {"distance": np.asarray(-np.log(share) / self._damping)}


INDUCTIVE = Kind(settings=InductiveSection, world=InductiveWorld, frontend=LcFrontend)
RECORDED_INDUCTANCE = Kind(
    settings=RecordedInductanceSection, world=RecordedInductanceWorld, frontend=LcFrontend
)
