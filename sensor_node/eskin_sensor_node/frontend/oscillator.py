"""Chains in which an oscillator turns the quantity into a frequency (Fig. 3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.frontend.amplified import Amplified
from eskin_sensor_node.machine.converter import Converter
from eskin_sensor_node.physics.parameters import draw_noise, draw_part

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.frontend.amplified import Digitised
    from eskin_sensor_node.taxels import InductiveSection
    from eskin_sensor_node.taxels.capacitive import RcSection
    from eskin_sensor_node.taxels.noise import Noise


class RcFrontend(Amplified):
    """C → RC oscillator (eq. 6) → V = f/f_ref → I = Gm·V → ADC.

    Args:
        taxel: Its data sheet.
        random: Draws the true parts.
        noise: On the current, before the ADC; ``None``: the taxel is disturbed before the chain.
    """

    def __init__(
        self, taxel: RcSection, random: np.random.Generator, *, noise: Noise | None
    ) -> None:
        self._resistance = draw_part(random, taxel.resistance_ohm, taxel.resistance_tolerance)
        self._reference = draw_part(random, taxel.reference, taxel.reference_tolerance)
        self._transconductance = draw_part(
            random, taxel.transconductance, taxel.transconductance_tolerance
        )
        self._converter = Converter(taxel, random)
        self._noise = noise

    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Codes of the current."""
        frequency = 1.0 / (2.0 * np.pi * self._resistance * sensed["capacitance"])
        current = np.asarray(self._transconductance * (frequency / self._reference))
        noisy = current
        if self._noise is not None:
            noisy = current + draw_noise(random, self._noise, current.shape)
        return self._digitised({"current": current}, {"current": noisy})


class LcFrontend(Amplified):
    """L → LC oscillator (eq. 12) → V = f/f_ref → ADC."""

    def __init__(self, taxel: InductiveSection, random: np.random.Generator) -> None:
        self._capacitance = draw_part(random, taxel.capacitance, taxel.capacitance_tolerance)
        self._reference = draw_part(random, taxel.reference, taxel.reference_tolerance)
        self._converter = Converter(taxel, random)
        self._noise = taxel.noise

    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Codes of the detector's voltage."""
        frequency = 1.0 / (2.0 * np.pi * np.sqrt(sensed["inductance"] * self._capacitance))
        voltage = frequency / self._reference
        noisy = voltage + draw_noise(random, self._noise, voltage.shape)
        return self._digitised({"frequency": frequency}, {"voltage": noisy})
