"""Taxels that see metal by a coil (eq. 11 to 13)."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from eskin_sensor_node.taxels.settings import Positive, Rate, TaxelSection, Tolerance, above, unit
from eskin_sensor_node.world.replay import Recorded
from eskin_sensor_node.world.scenario.fit import Staged


class InductiveSection(TaxelSection):
    """What all taxels have that see metal by a coil (eq. 11, 12). Noise: in V, before the ADC."""

    chain: ClassVar[str] = "inductive"
    units: ClassVar[dict[str, str]] = {"frequency": "Hz", "inductance": "H", "distance": "m"}

    sampling: Rate = unit("sampling_Hz", 1000.0)
    inductance: Positive = unit("inductance_H", 10e-3)
    inductance_tolerance: Tolerance = 1e-3
    inductance_change: Positive = unit("inductance_change_H", 5e-3)
    inductance_change_tolerance: Tolerance = 2e-3
    damping_per_m: Positive = 10.0
    damping_tolerance: Tolerance = 2e-3
    capacitance: Positive = unit("capacitance_F", 1e-6)
    capacitance_tolerance: Tolerance = 1e-3
    reference: Positive = unit("reference_Hz", 2500.0)
    reference_tolerance: Tolerance = 1e-5
    adc_min: float = unit("adc_min_V", 0.75, ge=0)
    adc_max: float = unit("adc_max_V", 0.9)
    frequency_prominence: Positive | None = unit("frequency_prominence_Hz", None)
    inductance_prominence: Positive | None = unit("inductance_prominence_H", None)
    distance_prominence: Positive | None = unit("distance_prominence_m", None)

    @field_validator("inductance_change")
    @classmethod
    def _coil_stays_a_coil(cls, value: float, info: ValidationInfo) -> float:
        base, tolerance = info.data.get("inductance"), info.data.get("inductance_tolerance")
        if base is not None and tolerance is not None and value >= 0.6 * base * (1 - tolerance):
            raise ValueError(
                f"it must be less than 0.6 of inductance_H = {base!r} at its lower tolerance"
            )
        return value

    @field_validator("adc_max")
    @classmethod
    def _adc_range(cls, value: float, info: ValidationInfo) -> float:
        return above(info, value, "adc_min_V", "adc_min")


class SwingSection(InductiveSection):
    """Metal whose distance swings harmonically (eq. 11 to 13). Noise: in V, before the ADC."""

    kind: Literal["inductive"]
    distance_amplitude_m: Annotated[float, Field(ge=0)] = 0.01
    distance_mid_m: Positive = 0.02
    stimulus: Positive = unit("stimulus_Hz", 1.0)

    @field_validator("distance_mid_m")
    @classmethod
    def _in_front_of_the_coil(cls, value: float, info: ValidationInfo) -> float:
        return above(info, value, "distance_amplitude_m", "distance_amplitude_m")


class CoilSection(Staged, InductiveSection):
    """Coil in a skin that sees metal as a scenario has it. Noise: in V, before each ADC."""

    chain: ClassVar[str] = "coil"
    units: ClassVar[dict[str, str]] = {
        **InductiveSection.units,
        "eddy_amplitude": "1",
        "eddy_phase": "rad",
    }
    disturbances: ClassVar[int] = 2

    kind: Literal["coil"]
    coil_resistance_ohm: Positive = Field(default=5.0, description="its loss resistance")
    coil_resistance_tolerance: Tolerance = 5e-3
    excitation: Positive = unit(
        "excitation_Hz", 1000.0, description="frequency at which eddy currents are seen"
    )
    excitation_tolerance: Tolerance = 1e-5
    drive: Positive = unit("drive_V", 1.0, description="amplitude of the excitation")
    drive_tolerance: Tolerance = 1e-3
    demodulator_gain: Positive = unit("demodulator_gain_V_per_A", 30.0)
    demodulator_gain_tolerance: Tolerance = 1e-3
    demodulator_max: Positive = unit(
        "demodulator_max_V", 1.25, description="upper end of its converters' range, from 0 V"
    )
    eddy_amplitude_prominence: Positive | None = None
    eddy_phase_prominence: Positive | None = unit("eddy_phase_prominence_rad", None)


class RecordedInductanceSection(Recorded, InductiveSection):
    """Inductance out of a recording, behind the chain of a coil. Noise: in V, before the ADC."""

    kind: Literal["recorded_inductance"]
