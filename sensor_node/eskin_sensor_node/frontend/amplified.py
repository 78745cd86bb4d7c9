"""What all analogue chains have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

    from eskin.interval import Floats
    from eskin_sensor_node.machine.converter import Codes, Converter


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


class Frontend(Protocol):
    """An analogue chain with its ADC."""

    def digitise(self, sensed: Mapping[str, Floats], random: np.random.Generator) -> Digitised:
        """Run the chain on what the sensor gives."""

    def adjust(self, gain: float, trim: int) -> None:
        """Set the amplifier before the converter, and the trimmer to one of its steps."""

    def repeat(self, held: Floats, gain: float, trim: int) -> Codes:
        """Codes of what is held, with another gain and step of the trimmer."""


class Amplified:
    """What all chains have: a converter behind an amplifier."""

    _converter: Converter

    def adjust(self, gain: float, trim: int) -> None:
        """Set the amplifier before the converter, and the trimmer to one of its steps."""
        self._converter.adjust(gain, trim)

    def repeat(self, held: Floats, gain: float, trim: int) -> Codes:
        """Codes of what is held, with another gain and step of the trimmer."""
        return self._converter.repeat(held, gain, trim)

    def _digitised(self, truth: dict[str, Floats], held: dict[str, Floats]) -> Digitised:
        codes = {name: self._converter.convert(values) for name, values in held.items()}
        return Digitised(truth, codes, held)
