"""Settings of a taxel (one sensing element): a ``[[taxel]]`` table of a node's file.

Keys carry their SI unit. A tolerance is relative: the true part lies anywhere inside
``value · [1 - tolerance, 1 + tolerance]``, and this is all that the firmware knows of it.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from eskin.settings import Section
from sensor_node.machine.crystal import BILLION
from sensor_node.noise import Noise
from sensor_node.replay import Recorded
from sensor_node.scenario.fit import Staged, require_pressure, require_room

Tolerance: TypeAlias = Annotated[float, Field(ge=0, lt=0.5)]
Positive: TypeAlias = Annotated[float, Field(gt=0)]


def period(hertz: float) -> int:
    """Sampling period in ns."""
    return round(BILLION / hertz)


def _whole_period(hertz: float) -> float:
    if abs(period(hertz) * hertz - BILLION) > 1e-6 * BILLION:
        raise ValueError("the sampling period must be a whole number of nanoseconds")
    return hertz


Rate: TypeAlias = Annotated[float, Field(gt=0, le=1e6), AfterValidator(_whole_period)]


def _unit(alias: str, default: Any = ..., **limits: Any) -> Any:
    """A field whose key in the file carries a unit that is no Python name."""
    return Field(default, alias=alias, **limits)


def _above(info: ValidationInfo, value: float, key: str, name: str) -> float:
    """Refuse an upper end that is not above its lower end."""
    lower = info.data.get(name)
    if lower is not None and value <= lower:
        raise ValueError(f"it must be greater than {key} = {lower!r}")
    return value


class TaxelSection(Section):
    """What all taxels have."""

    model_config = ConfigDict(strict=True)

    units: ClassVar[dict[str, str]] = {}
    """Quantity to UCUM unit, in the order of its channels."""

    id: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,30}$", description="such as t01")
    noise: Noise = Field(description="disturbance of the measurement")
    adc_bits: int = Field(default=12, ge=4, le=24, description="the converter's resolution")
    adc_gain_error: Tolerance = 0.0
    adc_offset_error: float = Field(default=0.0, ge=0, le=1000, description="in steps")
    adc_nonlinearity: float = Field(default=0.0, ge=0, le=1000, description="INL, in steps")
    longest_region_s: float = Field(
        default=5.0, gt=0, description="after this time an undecided stretch is reported"
    )

    def prominence(self, quantity: str) -> float | None:
        """Least prominence of a peak, in the channel's unit; ``None``: peaks are not sought."""
        value: float | None = getattr(self, f"{quantity}_prominence")
        return value


class _RcSection(TaxelSection):
    """Fig. 3: RC oscillator, frequency detector, V→I converter, ADC."""

    sampling: Rate = _unit("sampling_Hz", 1000.0)
    resistance_ohm: Positive = 1e3
    resistance_tolerance: Tolerance = 1e-3
    reference: Positive = _unit("reference_Hz")
    reference_tolerance: Tolerance = 1e-5
    transconductance: Positive = _unit("transconductance_A_per_V", 1e-3)
    transconductance_tolerance: Tolerance = 1e-3
    adc_min: float = _unit("adc_min_A", 0.0, ge=0)
    adc_max: float = _unit("adc_max_A", 1e-3)

    @field_validator("adc_max")
    @classmethod
    def _adc_range(cls, value: float, info: ValidationInfo) -> float:
        return _above(info, value, "adc_min_A", "adc_min")


class CapacitiveSection(_RcSection):
    """What all taxels have whose capacitance is measured (eq. 6). Noise: in A, before the ADC."""

    units: ClassVar[dict[str, str]] = {"capacitance": "F", "current": "A"}

    capacitance_prominence: Positive | None = _unit("capacitance_prominence_F", None)
    current_prominence: Positive | None = _unit("current_prominence_A", None)


class HarmonicSection(CapacitiveSection):
    """Capacitive taxel under a harmonic stimulus (eq. 5, 6). Noise: in A, before the ADC."""

    kind: Literal["capacitive"]
    capacitance_min: Positive = _unit("capacitance_min_F")
    capacitance_max: Positive = _unit("capacitance_max_F")
    capacitance_tolerance: Tolerance = 0.02
    stimulus: Positive = _unit("stimulus_Hz", 2.0)

    @field_validator("capacitance_max")
    @classmethod
    def _capacitance_range(cls, value: float, info: ValidationInfo) -> float:
        return _above(info, value, "capacitance_min_F", "capacitance_min")


class RecordedCapacitanceSection(Recorded, CapacitiveSection):
    """Capacitance out of a recording, behind the chain of Fig. 3. Noise: in A, before the ADC."""

    kind: Literal["recorded_capacitance"]


class PadSection(Staged, CapacitiveSection):
    """Capacitive taxel of a skin, pressed as a scenario has it. Noise: in A, before the ADC.

    Two plates with an elastic layer between them; docs/scenarios.md has its model.
    """

    kind: Literal["pad"]
    plate_area_m2: Positive
    plate_area_tolerance: Tolerance = 1e-3
    plate_distance_m: Positive = Field(default=1e-3, description="at rest")
    plate_distance_tolerance: Tolerance = 1e-3
    relative_permittivity: float = Field(default=3.0, ge=1, description="at 20 °C and 50 %")
    relative_permittivity_tolerance: Tolerance = 1e-3
    permittivity_per_K: float = Field(default=1e-3, ge=-0.01, le=0.01, description="relative")
    permittivity_per_percent: float = Field(default=5e-4, ge=-5e-3, le=5e-3, description="relative")
    elasticity_Pa: Positive = Field(default=1e5, description="pressure that halves the distance")
    elasticity_tolerance: Tolerance = 0.02
    pressure_max_Pa: Positive = Field(default=5e4, description="greatest pressure of a contact")

    @model_validator(mode="after")
    def _fits_the_scenario(self) -> Self:
        require_pressure(self.scenario, self.pressure_max_Pa)
        require_room(self.scenario, self.plate_area_m2)
        return self


class TouchSection(_RcSection):
    """Touch that covers a plate (eq. 2, 10). Noise: on the area, in m²."""

    units: ClassVar[dict[str, str]] = {"area": "m2", "capacitance": "F", "energy": "J"}

    kind: Literal["touch"]
    area_min_m2: Positive = 1e-5
    area_max_m2: Positive = 1e-4
    area_tolerance: Tolerance = 0.02
    plate_distance_m: Positive = 1e-3
    plate_distance_tolerance: Tolerance = 2e-3
    relative_permittivity: float = Field(default=1.0, ge=1)
    supply: Positive = _unit("supply_V", 5.0)
    supply_tolerance: Tolerance = 1e-3
    stimulus: Positive = _unit("stimulus_Hz", 0.8)
    area_prominence: Positive | None = _unit("area_prominence_m2", None)
    capacitance_prominence: Positive | None = _unit("capacitance_prominence_F", None)
    energy_prominence: Positive | None = _unit("energy_prominence_J", None)

    @field_validator("area_max_m2")
    @classmethod
    def _area_range(cls, value: float, info: ValidationInfo) -> float:
        return _above(info, value, "area_min_m2", "area_min_m2")


class InductiveSection(TaxelSection):
    """What all taxels have that see metal by a coil (eq. 11, 12). Noise: in V, before the ADC."""

    units: ClassVar[dict[str, str]] = {"frequency": "Hz", "inductance": "H", "distance": "m"}

    sampling: Rate = _unit("sampling_Hz", 1000.0)
    inductance: Positive = _unit("inductance_H", 10e-3)
    inductance_tolerance: Tolerance = 1e-3
    inductance_change: Positive = _unit("inductance_change_H", 5e-3)
    inductance_change_tolerance: Tolerance = 2e-3
    damping_per_m: Positive = 10.0
    damping_tolerance: Tolerance = 2e-3
    capacitance: Positive = _unit("capacitance_F", 1e-6)
    capacitance_tolerance: Tolerance = 1e-3
    reference: Positive = _unit("reference_Hz", 2500.0)
    reference_tolerance: Tolerance = 1e-5
    adc_min: float = _unit("adc_min_V", 0.75, ge=0)
    adc_max: float = _unit("adc_max_V", 0.9)
    frequency_prominence: Positive | None = _unit("frequency_prominence_Hz", None)
    inductance_prominence: Positive | None = _unit("inductance_prominence_H", None)
    distance_prominence: Positive | None = _unit("distance_prominence_m", None)

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
        return _above(info, value, "adc_min_V", "adc_min")


class SwingSection(InductiveSection):
    """Metal whose distance swings harmonically (eq. 11 to 13). Noise: in V, before the ADC."""

    kind: Literal["inductive"]
    distance_amplitude_m: Annotated[float, Field(ge=0)] = 0.01
    distance_mid_m: Positive = 0.02
    stimulus: Positive = _unit("stimulus_Hz", 1.0)

    @field_validator("distance_mid_m")
    @classmethod
    def _in_front_of_the_coil(cls, value: float, info: ValidationInfo) -> float:
        return _above(info, value, "distance_amplitude_m", "distance_amplitude_m")


class CoilSection(Staged, InductiveSection):
    """Coil in a skin that sees metal as a scenario has it. Noise: in V, before the ADC."""

    kind: Literal["coil"]
    coil_resistance_ohm: Positive = Field(default=5.0, description="its loss resistance")
    excitation: Positive = _unit(
        "excitation_Hz", 1000.0, description="frequency at which eddy currents are seen"
    )


class RecordedInductanceSection(Recorded, InductiveSection):
    """Inductance out of a recording, behind the chain of a coil. Noise: in V, before the ADC."""

    kind: Literal["recorded_inductance"]


class HybridSection(TaxelSection):
    """ICM: MagFES current and EcFES voltage after switching on (eq. 26, 27), in bursts.

    Noise: in V, before the bipolar ADC.
    """

    units: ClassVar[dict[str, str]] = {"current": "A", "voltage": "V"}

    kind: Literal["hybrid"]
    sampling: Rate = _unit("sampling_Hz", 100e3)
    burst_s: float = Field(default=0.04, gt=0)
    burst_period_s: float = Field(default=1.0, gt=0)
    amplitude: Positive = _unit("amplitude_V", 5.0)
    supply: Positive = _unit("supply_Hz", 50.0)
    phase_deg: float = Field(default=-46.0, ge=-180, le=180)
    coil_resistance_ohm: Positive = 10e3
    coil_inductance: Positive = _unit("coil_inductance_H", 1e-3)
    capacitor_resistance_ohm: Positive = 2419.0
    capacitance: Positive = _unit("capacitance_F", 1e-6)
    part_tolerance: Tolerance = 0.01
    current_gain: Positive = _unit("current_gain_V_per_A", 2000.0)
    current_gain_tolerance: Tolerance = 1e-3
    voltage_gain: Positive = _unit("voltage_gain_V_per_V", 0.25)
    voltage_gain_tolerance: Tolerance = 1e-3
    adc_max: Positive = _unit("adc_max_V", 1.25)
    current_prominence: Positive | None = _unit("current_prominence_A", None)
    voltage_prominence: Positive | None = _unit("voltage_prominence_V", None)

    @property
    def adc_min(self) -> float:
        """Lower end of the range, in V: the converter is bipolar."""
        return -self.adc_max

    @field_validator("burst_period_s")
    @classmethod
    def _bursts_do_not_overlap(cls, value: float, info: ValidationInfo) -> float:
        return _above(info, value, "burst_s", "burst_s")


AnyTaxel: TypeAlias = (
    HarmonicSection
    | PadSection
    | RecordedCapacitanceSection
    | TouchSection
    | SwingSection
    | CoilSection
    | RecordedInductanceSection
    | HybridSection
)
"""A taxel of any kind."""

Taxel: TypeAlias = Annotated[AnyTaxel, Field(discriminator="kind")]
"""The same, told apart by ``kind`` when read."""
