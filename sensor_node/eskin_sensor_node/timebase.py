"""A quartz crystal: its ticks are a little longer or shorter than they should be."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_STEADY: Final = 0.6
"""Share of the data sheet's bound that cutting and ageing take; temperature takes the rest."""
_SWING_NS: Final = 1.8e12
"""How fast its temperature follows the room's: half an hour."""
BILLION: Final = 1_000_000_000


class Crystal:
    """Turns ticks (nominal ns) into true ns.

    The rate error is a constant plus a swing with the temperature, together within the bound.

    Args:
        drift: Greatest rate error, in parts of 1e9.
        random: Draws the true one.
    """

    def __init__(self, drift: int, random: np.random.Generator) -> None:
        self._steady = _STEADY * drift * random.uniform(-1.0, 1.0) / BILLION
        self._swing = (1.0 - _STEADY) * drift * random.uniform(-1.0, 1.0) / BILLION
        self._pace = 2.0 * math.pi / _SWING_NS

    def elapsed(self, ticks: NDArray[np.int64] | int) -> NDArray[np.int64]:
        """True ns since the start, when the crystal has counted these ticks."""
        nominal = np.asarray(ticks, dtype=np.float64)
        swing = self._swing * (1.0 - np.cos(self._pace * nominal)) / self._pace
        # Toward the nominal: rounding must not carry it past the bound.
        return np.asarray(ticks) + np.trunc(self._steady * nominal + swing).astype(np.int64)
