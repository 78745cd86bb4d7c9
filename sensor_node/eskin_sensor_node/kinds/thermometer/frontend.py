"""The chain of a thermometer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.firmware.inversion.thermometer import A, B, C
from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.frontend import Frontend
from eskin_sensor_node.kinds.parameters import draw_noise, draw_part

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.frontend import Digitised
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.thermometer.settings import ThermometerSection


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
