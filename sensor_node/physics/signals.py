"""True signals of one taxel over some samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from eskin.interval import Floats


@dataclass(frozen=True, slots=True)
class Signals:
    """What is, and what reaches the analogue chain.

    Attributes:
        truth: Quantity to its true values, without noise, in SI units.
        sensed: Quantity to what the chain gets; differs where the sensor itself is disturbed.
    """

    truth: dict[str, Floats]
    sensed: dict[str, Floats]


def raised_sine(seconds: Floats, hertz: float) -> Floats:
    """``0.5 + 0.5 sin(2π f t)`` of eq. 5, 9 and 10."""
    return np.asarray(0.5 + 0.5 * np.sin(2.0 * np.pi * hertz * seconds))
