"""An analogue-to-digital converter with its true errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats

Codes: TypeAlias = "NDArray[np.int64]"


class ConverterSheet(Protocol):
    """The data sheet of a converter: its range, its resolution, bounds of its errors."""

    adc_bits: int
    adc_gain_error: float
    adc_offset_error: float
    adc_nonlinearity: float
    gain_tolerance: float
    trimmer_step: float
    trimmer_steps: int
    trimmer_tolerance: float

    @property
    def adc_min(self) -> float:
        """Lower end of the range."""

    @property
    def adc_max(self) -> float:
        """Upper end of the range."""


class Converter:
    """Code c stands for inputs of ``lo + offset + (c + [0, 1] - inl)·step·(1 + gain error)``.

    Before it are an amplifier, and a trimmer that takes an offset away: ``gain·x - trim``.

    The end codes saturate. The integral nonlinearity bows over the range and back, as that of a
    capacitor array does, within the data sheet's bound.

    Args:
        taxel: Its data sheet.
        random: Draws the true errors.
    """

    def __init__(self, taxel: ConverterSheet, random: np.random.Generator) -> None:
        codes = 1 << taxel.adc_bits
        step = (taxel.adc_max - taxel.adc_min) / codes
        self.last = codes - 1
        self._codes = codes
        self._step = step * (1.0 + taxel.adc_gain_error * random.uniform(-1.0, 1.0))
        self._zero = taxel.adc_min + taxel.adc_offset_error * step * random.uniform(-1.0, 1.0)
        self._bow = taxel.adc_nonlinearity * random.uniform(-1.0, 1.0)
        self._amplifier = 1.0 + taxel.gain_tolerance * random.uniform(-1.0, 1.0)
        errors = taxel.trimmer_tolerance * random.uniform(-1.0, 1.0, 2 * taxel.trimmer_steps + 1)
        levels = np.arange(-taxel.trimmer_steps, taxel.trimmer_steps + 1)
        # Columns of converters have a column of errors for each level.
        levels = levels.reshape(-1, *[1] * (errors.ndim - 1))
        self._trims = levels * taxel.trimmer_step * (taxel.adc_max - taxel.adc_min) * (1.0 + errors)
        self.adjust(1.0, 0)

    def adjust(self, gain: float, trim: int) -> None:
        """Set the amplifier, and the trimmer to one of its steps."""
        self._gain, self._trim = self._amplified(gain, trim)

    def convert(self, values: Floats) -> Codes:
        """Quantise; what lies outside of the range takes the end codes."""
        return self._quantised(values, self._gain, self._trim)

    def repeat(self, held: Floats, gain: float, trim: int) -> Codes:
        """Quantise what is held with another gain and step; the next values have the old ones."""
        return self._quantised(held, *self._amplified(gain, trim))

    def _amplified(self, gain: float, trim: int) -> tuple[float, float]:
        return gain * self._amplifier, self._trims[trim + len(self._trims) // 2]

    def _quantised(self, values: Floats, gain: float, trim: float) -> Codes:
        steps = (gain * values - trim - self._zero) / self._step
        bowed = steps + self._bow * np.sin(2.0 * np.pi * steps / self._codes)
        return np.clip(np.floor(bowed), 0, self.last).astype(np.int64)
