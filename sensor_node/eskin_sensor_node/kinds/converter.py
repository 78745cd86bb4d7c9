"""An analogue-to-digital converter with its true errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np

from eskin_sensor_node.kinds.parameters import at_step

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator

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
    """Converters of one data sheet, a column each.

    Code c stands for inputs of ``lo + offset + (c + [0, 1] - inl)·step·(1 + gain error)``.

    Before it are an amplifier, and a trimmer that takes an offset away: ``gain·x - trim``.

    The end codes saturate. The integral nonlinearity bows over the range and back, as that of a
    capacitor array does, within the data sheet's bound.

    Args:
        taxel: Its data sheet.
        random: Draws the true errors.
    """

    def __init__(self, taxel: ConverterSheet, random: ColumnGenerator) -> None:
        codes = 1 << taxel.adc_bits
        step = (taxel.adc_max - taxel.adc_min) / codes
        self.last = codes - 1
        self._codes = codes
        self._step = step * (1.0 + taxel.adc_gain_error * random.uniform(-1.0, 1.0))
        self._zero = taxel.adc_min + taxel.adc_offset_error * step * random.uniform(-1.0, 1.0)
        self._bow = taxel.adc_nonlinearity * random.uniform(-1.0, 1.0)
        self._amplifier = 1.0 + taxel.gain_tolerance * random.uniform(-1.0, 1.0)
        errors = taxel.trimmer_tolerance * random.uniform(-1.0, 1.0, 2 * taxel.trimmer_steps + 1)
        levels = np.arange(-taxel.trimmer_steps, taxel.trimmer_steps + 1)[:, None, None]
        self._trims = levels * taxel.trimmer_step * (taxel.adc_max - taxel.adc_min) * (1.0 + errors)
        self.adjust(1.0, 0)

    def adjust(self, gain: ArrayLike, trim: ArrayLike) -> None:
        """Set the amplifiers, and the trimmers to steps of theirs: columns × 1, or one for all."""
        self._gain, self._trim = self._amplified(gain, trim)

    def convert(self, values: Floats) -> Codes:
        """Quantise; what lies outside of the range takes the end codes."""
        return self._quantised(values, self._gain, self._trim)

    def repeat(self, held: Floats, gain: ArrayLike, trim: ArrayLike) -> Codes:
        """Quantise what is held with another gain and step; the next values have the old ones."""
        return self._quantised(held, *self._amplified(gain, trim))

    def _amplified(self, gain: ArrayLike, trim: ArrayLike) -> tuple[Floats, Floats]:
        steps = np.asarray(trim) + len(self._trims) // 2
        return np.asarray(gain) * self._amplifier, at_step(self._trims, steps)

    def _quantised(self, values: Floats, gain: Floats, trim: Floats) -> Codes:
        steps = (gain * values - trim - self._zero) / self._step
        bowed = steps + self._bow * np.sin(2.0 * np.pi * steps / self._codes)
        return np.clip(np.floor(bowed), 0, self.last).astype(np.int64)
