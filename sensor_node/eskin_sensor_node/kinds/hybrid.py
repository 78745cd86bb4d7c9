"""The ICM hybrid after switching on (eq. 26 and 27 of the paper, in its reduced form).

With ``θ = ωt + ψ``, ``x = ωτ`` and ``h = [sin θ - x cos θ - (sin ψ - x cos ψ)·e^(-t/τ)]/(1 + x²)``:
``i1 = Vm/R1 · h`` with ``τ = L/R1``, and ``u_c = Vm · h`` with ``τ = R2·C``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from eskin_sensor_node.firmware.taxel.hybrid import HybridTaxel
from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.frontend import Frontend
from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.parameters import draw_noise, draw_part
from eskin_sensor_node.kinds.settings import Positive, Rate, TaxelSection, Tolerance, above, unit
from eskin_sensor_node.kinds.signals import Signals, World

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.frontend import Digitised
    from eskin_sensor_node.kinds.generator import ColumnGenerator


class HybridSection(TaxelSection):
    """ICM: MagFES current and EcFES voltage after switching on (eq. 26, 27), in bursts.

    Noise: in V, before the bipolar ADC.
    """

    firmware: ClassVar[type[HybridTaxel]] = HybridTaxel

    kind: Literal["hybrid"]
    sampling: Rate = unit("sampling_Hz", 100e3)
    burst_s: float = Field(default=0.04, gt=0)
    burst_period_s: float = Field(default=1.0, gt=0)
    amplitude: Positive = unit("amplitude_V", 5.0)
    supply: Positive = unit("supply_Hz", 50.0)
    phase_deg: float = Field(default=-46.0, ge=-180, le=180)
    coil_resistance_ohm: Positive = 10e3
    coil_inductance: Positive = unit("coil_inductance_H", 1e-3)
    capacitor_resistance_ohm: Positive = 2419.0
    capacitance: Positive = unit("capacitance_F", 1e-6)
    part_tolerance: Tolerance = 0.01
    current_gain: Positive = unit("current_gain_V_per_A", 2000.0)
    current_gain_tolerance: Tolerance = 1e-3
    voltage_gain: Positive = unit("voltage_gain_V_per_V", 0.25)
    voltage_gain_tolerance: Tolerance = 1e-3
    adc_max: Positive = unit("adc_max_V", 1.25)
    current_prominence: Positive | None = unit("current_prominence_A", None)
    voltage_prominence: Positive | None = unit("voltage_prominence_V", None)

    @property
    def adc_min(self) -> float:
        """Lower end of the range, in V: the converter is bipolar."""
        return -self.adc_max

    @property
    def burst(self) -> tuple[float, float]:
        """Length and period in s of its bursts."""
        return self.burst_s, self.burst_period_s

    @field_validator("burst_period_s")
    @classmethod
    def _bursts_do_not_overlap(cls, value: float, info: ValidationInfo) -> float:
        return above(info, value, "burst_s", "burst_s")


class HybridWorld(World):
    """MagFES current and EcFES voltage, both zero at the trigger."""

    def __init__(self, taxel: HybridSection, random: ColumnGenerator) -> None:
        def part(value: float) -> Floats:
            return draw_part(random, value, taxel.part_tolerance)

        self._amplitude = part(taxel.amplitude)
        self._coil_resistance = part(taxel.coil_resistance_ohm)
        self._coil_time = part(taxel.coil_inductance) / self._coil_resistance
        self._capacitor_time = part(taxel.capacitor_resistance_ohm) * part(taxel.capacitance)
        self._omega = 2.0 * math.pi * taxel.supply
        self._phase = math.radians(taxel.phase_deg)

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """True current in A and voltage in V, at times since the trigger."""
        del random
        most = self._amplitude / self._coil_resistance
        truth = {
            "current": most * self._response(seconds, self._coil_time),
            "voltage": self._amplitude * self._response(seconds, self._capacitor_time),
        }
        return Signals(truth, truth)

    def _response(self, seconds: Floats, tau: Floats) -> Floats:
        x, angle = self._omega * tau, self._omega * seconds + self._phase
        start = math.sin(self._phase) - x * math.cos(self._phase)
        response = np.sin(angle) - x * np.cos(angle) - start * np.exp(-seconds / tau)
        return np.asarray(response / (1.0 + x * x))


class HybridFrontend(Frontend):
    """Current and voltage, each through an amplifier to a bipolar ADC."""

    def __init__(self, taxel: HybridSection, random: ColumnGenerator) -> None:
        self._gains = {
            "current": draw_part(random, taxel.current_gain, taxel.current_gain_tolerance),
            "voltage": draw_part(random, taxel.voltage_gain, taxel.voltage_gain_tolerance),
        }
        self._converter = Converter(taxel, random)
        self._noise = taxel.noise

    def digitise(self, sensed: Mapping[str, Floats], random: ColumnGenerator) -> Digitised:
        """Codes of both amplifiers' voltages."""
        held = {
            quantity: gain * sensed[quantity] + draw_noise(random, self._noise)
            for quantity, gain in self._gains.items()
        }
        return self._digitised({}, held)


HYBRID = Kind(settings=HybridSection, world=HybridWorld, frontend=HybridFrontend)
