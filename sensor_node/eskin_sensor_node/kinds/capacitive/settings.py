"""Settings of a capacitance under a harmonic stimulus, or out of a recording."""

from __future__ import annotations

from typing import Literal

from pydantic import ValidationInfo, field_validator

from eskin_sensor_node.kinds.rc import CapacitanceSection
from eskin_sensor_node.kinds.settings import Positive, Tolerance, above, unit
from eskin_sensor_node.world.replay import Recorded


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
