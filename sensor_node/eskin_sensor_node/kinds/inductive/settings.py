"""Settings of a coil before which metal swings, or of a recorded inductance."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from eskin_sensor_node.kinds.lc import LcSection
from eskin_sensor_node.kinds.settings import Positive, above, unit
from eskin_sensor_node.world.replay import Recorded


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
