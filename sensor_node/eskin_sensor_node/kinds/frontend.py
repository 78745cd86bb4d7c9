"""What all analogue chains have, down to the ADC's codes (Fig. 3 of the paper)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.converter import Codes, Converter
    from eskin_sensor_node.kinds.generator import ColumnGenerator


@dataclass(frozen=True, slots=True)
class Digitised:
    """What the chains made of the signals, columns × instants.

    Attributes:
        truth: Quantities that come to be in the chain, without noise.
        codes: One array of ADC codes an input.
        held: Of each input behind the adjustable amplifier, what is held before it.
    """

    truth: dict[str, Floats]
    codes: dict[str, Codes]
    held: dict[str, Floats]

    def part(self, begin: int, end: int) -> Digitised:
        """Some of the instants."""
        truth, held = (
            {name: values[:, begin:end] for name, values in each.items()}
            for each in (self.truth, self.held)
        )
        return Digitised(truth, {k: codes[:, begin:end] for k, codes in self.codes.items()}, held)


class Frontend(ABC):
    """Analogue chains of one data sheet, a column each, with an ADC behind an amplifier."""

    _converter: Converter

    @abstractmethod
    def digitise(self, sensed: Mapping[str, Floats], random: ColumnGenerator) -> Digitised:
        """Run the chain on what the sensor gives."""

    def adjust(self, gain: ArrayLike, trim: ArrayLike) -> None:
        """Set the amplifiers before the converters, and the trimmers to steps of theirs."""
        self._converter.adjust(gain, trim)

    def repeat(self, held: Floats, gain: ArrayLike, trim: ArrayLike) -> Codes:
        """Codes of what is held, with other gains and steps of the trimmers."""
        return self._converter.repeat(held, gain, trim)

    def _digitised(self, truth: dict[str, Floats], held: dict[str, Floats]) -> Digitised:
        codes = {name: self._converter.convert(values) for name, values in held.items()}
        return Digitised(truth, codes, held)
