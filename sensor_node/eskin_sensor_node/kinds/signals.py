"""True signals of some taxels over some samples."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator


@dataclass(frozen=True, slots=True)
class Signals:
    """What is, and what reaches the analogue chain: columns × instants, or 1 × instants.

    Attributes:
        truth: Quantity to its true values, without noise, in SI units.
        sensed: Quantity to what the chain gets; differs where the sensor itself is disturbed.
        ends: Where the world itself is known as intervals, what the chain gets at each end of them.
        missing: At which instants nothing is; ``None``: at none.
    """

    truth: dict[str, Floats]
    sensed: dict[str, Floats]
    ends: tuple[dict[str, Floats], ...] = ()
    missing: NDArray[np.bool_] | None = None


class World(ABC):
    """True parts and true signals of taxels of one data sheet, a column each."""

    @abstractmethod
    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """True signals at instants since the start (a burst: since its trigger).

        Args:
            seconds: Columns × instants, or 1 × instants where all columns have one clock.
            random: Draws noise of the sensing elements.
        """

    def move(self, steps: ArrayLike) -> None:  # noqa: B027 - most kinds have no plates
        """Move the plates to steps of their actuators, columns × 1, or one for all."""


def raised_sine(seconds: Floats, hertz: float) -> Floats:
    """``0.5 + 0.5 sin(2π f t)`` of eq. 5, 9 and 10."""
    return np.asarray(0.5 + 0.5 * np.sin(2.0 * np.pi * hertz * seconds))
