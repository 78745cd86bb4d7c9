"""A platinum resistor that measures the temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from eskin_sensor_node.firmware.inversion.thermometer import A, B, C
from eskin_sensor_node.firmware.taxel.thermometer import ThermometerTaxel
from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.frontend import Frontend
from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.parameters import draw_noise, draw_part
from eskin_sensor_node.kinds.settings import Positive, Rate, TaxelSection, Tolerance, above, unit
from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.world.scenario import read_scenario
from eskin_sensor_node.world.scenario.fit import Played

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.frontend import Digitised
    from eskin_sensor_node.kinds.generator import ColumnGenerator


class ThermometerSection(Played, TaxelSection):
    """Platinum resistor in a divider (IEC 60751). Noise: as a share of the supply, before the ADC.

    The divider's supply is the converter's reference, too, so that it cancels.
    """

    firmware: ClassVar[type[ThermometerTaxel]] = ThermometerTaxel

    kind: Literal["thermometer"]
    sampling: Rate = unit("sampling_Hz", 50.0)
    nominal_ohm: Positive = Field(default=1000.0, description="at 0 °C, without its tolerance")
    tolerance_K: float = Field(default=0.15, ge=0, le=10, description="class A: 0.15, B: 0.3")
    tolerance_per_K: float = Field(
        default=0.002, ge=0, le=0.05, description="for each K away from 0 °C; A: 0.002, B: 0.005"
    )
    series_resistance_ohm: Positive = 1000.0
    series_resistance_tolerance: Tolerance = 1e-4
    adc_min: float = Field(default=0.44, ge=0, lt=1, description="share of the supply")
    adc_max: float = Field(default=0.6, gt=0, lt=1, description="share of the supply")
    temperature_prominence: Positive | None = unit("temperature_prominence_K", None)

    @field_validator("adc_max")
    @classmethod
    def _adc_range(cls, value: float, info: ValidationInfo) -> float:
        return above(info, value, "adc_min", "adc_min")


class ThermometerWorld(World):
    """Temperature of the air."""

    def __init__(self, taxel: ThermometerSection, random: ColumnGenerator) -> None:
        del random
        self._script = read_scenario(taxel.scenario)

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """True temperature in °C."""
        del random
        _, local = self._script.local(seconds)
        truth = {"temperature": self._script.ambient.temperature(local)}
        return Signals(truth, truth)


class ThermometerFrontend(Frontend):
    """Temperature → platinum resistor (IEC 60751) → divider → ADC."""

    def __init__(self, taxel: ThermometerSection, random: ColumnGenerator) -> None:
        self._nominal = taxel.nominal_ohm
        self._constant, self._growing = (
            bound * random.uniform(-1.0, 1.0)
            for bound in (taxel.tolerance_K, taxel.tolerance_per_K)
        )
        self._series = draw_part(
            random, taxel.series_resistance_ohm, taxel.series_resistance_tolerance
        )
        self._converter = Converter(taxel, random)
        self._noise = taxel.noise

    def digitise(self, sensed: Mapping[str, Floats], random: ColumnGenerator) -> Digitised:
        """Codes of the divider's share of the supply."""
        true = sensed["temperature"]
        shown = true + self._constant + self._growing * np.abs(true)
        below = np.minimum(shown, 0.0)
        ratio = 1.0 + A * shown + B * shown**2 + C * (below - 100.0) * below**3
        resistance = self._nominal * ratio
        share = resistance / (resistance + self._series)
        noisy = share + draw_noise(random, self._noise)
        return self._digitised({}, {"share": noisy})


THERMOMETER = Kind(
    settings=ThermometerSection,
    world=ThermometerWorld,
    frontend=ThermometerFrontend,
    samples_per_code=8,  # air changes slowly
)
