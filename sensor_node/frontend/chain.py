"""The analogue chains of the taxels, each with its true parts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from sensor_node.machine.converter import Converter
from sensor_node.physics.parameters import draw_noise, draw_part
from sensor_node.taxels import CapacitiveSection, InductiveSection, TouchSection

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from sensor_node.machine.converter import Codes
    from sensor_node.taxels import AnyTaxel, HybridSection


@dataclass(frozen=True, slots=True)
class Digitised:
    """What the chain made of the signals.

    Attributes:
        truth: Quantities that come to be in the chain, without noise.
        codes: One array of ADC codes an input.
    """

    truth: dict[str, Floats]
    codes: dict[str, Codes]


class Frontend(Protocol):
    """An analogue chain with its ADC."""

    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Run the chain on what the sensor gives."""

    def amplify(self, gain: float) -> None:
        """Set the amplifier before the converter."""


class Amplified:
    """What all chains have: a converter behind an amplifier."""

    _converter: Converter

    def amplify(self, gain: float) -> None:
        """Set the amplifier before the converter."""
        self._converter.gain = gain


class RcFrontend(Amplified):
    """C → RC oscillator (eq. 6) → V = f/f_ref → I = Gm·V → ADC."""

    def __init__(
        self, taxel: CapacitiveSection | TouchSection, random: np.random.Generator
    ) -> None:
        self._resistance = draw_part(random, taxel.resistance_ohm, taxel.resistance_tolerance)
        self._reference = draw_part(random, taxel.reference, taxel.reference_tolerance)
        self._transconductance = draw_part(
            random, taxel.transconductance, taxel.transconductance_tolerance
        )
        self._converter = Converter(taxel, random)
        # A touch is disturbed at the plate, not behind it.
        self._noise = taxel.noise if isinstance(taxel, CapacitiveSection) else None

    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Codes of the current."""
        frequency = 1.0 / (2.0 * np.pi * self._resistance * sensed["capacitance"])
        current = np.asarray(self._transconductance * (frequency / self._reference))
        noisy = current
        if self._noise is not None:
            noisy = current + draw_noise(random, self._noise, current.shape)
        codes = self._converter.convert(noisy)
        return Digitised({"current": current}, {"current": codes})


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
        return Digitised({"frequency": frequency}, {"voltage": self._converter.convert(noisy)})


class LinearFrontend(Amplified):
    """Current and voltage, each through an amplifier to a bipolar ADC."""

    def __init__(self, taxel: HybridSection, random: np.random.Generator) -> None:
        self._gains = {
            "current": draw_part(random, taxel.current_gain, taxel.current_gain_tolerance),
            "voltage": draw_part(random, taxel.voltage_gain, taxel.voltage_gain_tolerance),
        }
        self._converter = Converter(taxel, random)
        self._noise = taxel.noise

    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Codes of both amplifiers' voltages."""
        codes = {
            quantity: self._converter.convert(
                gain * sensed[quantity] + draw_noise(random, self._noise, sensed[quantity].shape)
            )
            for quantity, gain in self._gains.items()
        }
        return Digitised({}, codes)


def build_frontend(taxel: AnyTaxel, random: np.random.Generator) -> Frontend:
    """Draw the true parts of a taxel's analogue chain."""
    if isinstance(taxel, CapacitiveSection | TouchSection):
        return RcFrontend(taxel, random)
    if isinstance(taxel, InductiveSection):
        return LcFrontend(taxel, random)
    return LinearFrontend(taxel, random)
