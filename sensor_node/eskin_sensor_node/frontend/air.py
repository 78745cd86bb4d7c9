"""The chains of thermometer and hygrometer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.firmware.inversion.humidity import REFERENCE_HUMIDITY
from eskin_sensor_node.firmware.inversion.temperature import A, B, C
from eskin_sensor_node.frontend.amplified import Amplified, Digitised
from eskin_sensor_node.frontend.oscillator import RcFrontend
from eskin_sensor_node.machine.converter import Converter
from eskin_sensor_node.physics.parameters import draw_noise, draw_part

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.taxels import HygrometerSection, ThermometerSection


class ThermometerFrontend(Amplified):
    """Temperature → platinum resistor (IEC 60751) → divider → ADC."""

    def __init__(self, taxel: ThermometerSection, random: np.random.Generator) -> None:
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

    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Codes of the divider's share of the supply."""
        true = sensed["temperature"]
        shown = true + self._constant + self._growing * np.abs(true)
        below = np.minimum(shown, 0.0)
        ratio = 1.0 + A * shown + B * shown**2 + C * (below - 100.0) * below**3
        resistance = self._nominal * ratio
        share = resistance / (resistance + self._series)
        noisy = share + draw_noise(random, self._noise, share.shape)
        return self._digitised({}, {"share": noisy})


class HygrometerFrontend(RcFrontend):
    """Humidity → polymer's capacitance → the chain of Fig. 3."""

    def __init__(self, taxel: HygrometerSection, random: np.random.Generator) -> None:
        super().__init__(taxel, random, noise=taxel.noise)
        self._rest = draw_part(random, taxel.capacitance, taxel.capacitance_tolerance)
        self._sensitivity = draw_part(random, taxel.sensitivity, taxel.sensitivity_tolerance)
        self._off = taxel.error_percent * random.uniform(-1.0, 1.0)

    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Codes of the current."""
        above = sensed["humidity"] + self._off - REFERENCE_HUMIDITY
        capacitance = self._rest * (1.0 + self._sensitivity * above)
        made = super().digitise({"capacitance": capacitance}, random)
        return Digitised({}, made.codes, made.held)
