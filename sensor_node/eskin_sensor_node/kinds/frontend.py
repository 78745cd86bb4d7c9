"""What all analogue chains have, down to the ADC's codes (Fig. 3 of the paper)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.converter import Codes, Converter


@dataclass(frozen=True, slots=True)
class Digitised:
    """What the chain made of the signals.

    Attributes:
        truth: Quantities that come to be in the chain, without noise.
        codes: One array of ADC codes an input.
        held: Of each input behind the adjustable amplifier, what is held before it.
    """

    truth: dict[str, Floats]
    codes: dict[str, Codes]
    held: dict[str, Floats]


class Frontend(ABC):
    """An analogue chain with an ADC behind an amplifier; each kind has its own."""

    _converter: Converter

    @abstractmethod
    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Run the chain on what the sensor gives."""

    def adjust(self, gain: float, trim: int) -> None:
        """Set the amplifier before the converter, and the trimmer to one of its steps."""
        self._converter.adjust(gain, trim)

    def repeat(self, held: Floats, gain: float, trim: int) -> Codes:
        """Codes of what is held, with another gain and step of the trimmer."""
        return self._converter.repeat(held, gain, trim)

    def _digitised(self, truth: dict[str, Floats], held: dict[str, Floats]) -> Digitised:
        codes = {name: self._converter.convert(values) for name, values in held.items()}
        return Digitised(truth, codes, held)


class CompaniedFrontend(Frontend):
    """A chain, and others with one input each that are sampled at the same instants.

    Args:
        own: The taxel's chain; it alone is adjusted.
        companions: Name of the input to the chain.
    """

    def __init__(self, own: Frontend, companions: Mapping[str, Frontend]) -> None:
        self._own = own
        self._companions = companions

    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Codes of all."""
        own = self._own.digitise(sensed, random)
        codes = dict(own.codes)
        for name, companion in self._companions.items():
            (codes[name],) = companion.digitise(sensed, random).codes.values()
        return Digitised(own.truth, codes, own.held)

    def adjust(self, gain: float, trim: int) -> None:
        """Set the amplifier before the taxel's own converter, and its trimmer."""
        self._own.adjust(gain, trim)

    def repeat(self, held: Floats, gain: float, trim: int) -> Codes:
        """Codes of what is held before the taxel's own amplifier."""
        return self._own.repeat(held, gain, trim)
