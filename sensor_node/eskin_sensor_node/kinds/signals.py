"""True signals of one taxel over some samples."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from eskin.interval import Floats


@dataclass(frozen=True, slots=True)
class Signals:
    """What is, and what reaches the analogue chain.

    Attributes:
        truth: Quantity to its true values, without noise, in SI units.
        sensed: Quantity to what the chain gets; differs where the sensor itself is disturbed.
        ends: Where the world itself is known as intervals, what the chain gets at each end of them.
        missing: At which samples nothing is; ``None``: at none.
    """

    truth: dict[str, Floats]
    sensed: dict[str, Floats]
    ends: tuple[dict[str, Floats], ...] = ()
    missing: NDArray[np.bool_] | None = None

    def runs(self, n: int) -> Iterator[tuple[int, int, bool]]:
        """Begin and end of each run of samples that are all there or all missing, and whether."""
        if self.missing is None:
            yield 0, n, True
            return
        edges = [0, *(np.flatnonzero(np.diff(self.missing)) + 1).tolist(), n]
        for begin, end in itertools.pairwise(edges):
            yield begin, end, not self.missing[begin]

    def part(self, begin: int, end: int) -> Signals:
        """Some of the samples, which are there."""
        truth, sensed, *ends = (
            {name: values[begin:end] for name, values in each.items()}
            for each in (self.truth, self.sensed, *self.ends)
        )
        return Signals(truth, sensed, tuple(ends))


class World(ABC):
    """True parts and true signals of one taxel."""

    @abstractmethod
    def signals(self, seconds: Floats, random: np.random.Generator) -> Signals:
        """True signals at instants since the start (a burst: since its trigger)."""

    def move(self, steps: int) -> None:  # noqa: B027 - most kinds have no plates
        """Move the plates to one of their actuator's steps; most kinds have no plates."""


def raised_sine(seconds: Floats, hertz: float) -> Floats:
    """``0.5 + 0.5 sin(2π f t)`` of eq. 5, 9 and 10."""
    return np.asarray(0.5 + 0.5 * np.sin(2.0 * np.pi * hertz * seconds))
