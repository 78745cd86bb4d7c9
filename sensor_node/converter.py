"""The data sheet of an analogue-to-digital converter: range, resolution, what a code means."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin.interval import Interval, round_down, round_up

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats

Codes: TypeAlias = "NDArray[np.int64]"

_EMULATION: Final = 2.0**-48
"""The emulated chain computes in float64, where a real one does not round: its few ulp, as a
part of the greater end of the range."""


@dataclass(frozen=True, slots=True)
class Converter:
    """An ideal ADC: code c stands for ``[lo + c·step, lo + (c+1)·step]``; the end codes saturate.

    Attributes:
        lo: Lower end of the range, in V or A.
        hi: Upper end.
        bits: Resolution.
    """

    lo: float
    hi: float
    bits: int

    @property
    def step(self) -> float:
        """Width of a code."""
        return (self.hi - self.lo) / (1 << self.bits)

    @property
    def last(self) -> int:
        """The highest code."""
        return (1 << self.bits) - 1

    def convert(self, values: Floats) -> Codes:
        """Quantise; what lies outside of the range takes the end codes."""
        steps = np.floor((values - self.lo) / self.step)
        return np.clip(steps, 0, self.last).astype(np.int64)

    def enclose(self, codes: Codes) -> Interval:
        """What the input may have been; unbounded on the side where a code saturates."""
        slack = _EMULATION * max(abs(self.lo), abs(self.hi))
        low = self.lo + Interval(codes.astype(np.float64)) * self.step
        high = self.lo + Interval((codes + 1).astype(np.float64)) * self.step
        return Interval(
            np.where(codes == 0, -np.inf, round_down(low.inf - slack)),
            np.where(codes == self.last, np.inf, round_up(high.sup + slack)),
        )
