"""A cohort's look at its members' taxels: the twin of `sensor_node.examiner.Examiner`."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import numpy as np

from sensor_node.examiner import SELF_TEST

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats


class Watch:
    """Finds taxels whose line is certainly open, each once in a boot.

    Only a design without neighbours samples in columns, so that none is ever certainly stuck.

    Args:
        taxels: Their names.
        nodes: How many nodes.

    Attributes:
        tested: Ticks at which the window begins.
    """

    def __init__(self, taxels: Sequence[str], nodes: int) -> None:
        self._taxels = taxels
        self._seen = np.zeros(len(taxels), bool)
        self._bounded = np.zeros((len(taxels), nodes), bool)
        self._broken = np.zeros((len(taxels), nodes), bool)
        self.tested = 0

    def take(self, taxel: int, bounded: NDArray[np.bool_]) -> None:
        """Take a frame in: at which nodes a sample of it was bounded."""
        self._seen[taxel] = True
        self._bounded[taxel] |= bounded

    def examine(self, ticks: int) -> list[tuple[int, str]]:
        """Where a window ends at some ticks: nodes and their taxels that are certainly dead."""
        if ticks - self.tested < SELF_TEST:
            return []
        dead = self._seen[:, None] & ~self._bounded & ~self._broken
        self._broken |= dead
        self._seen[:], self._bounded[:] = False, False
        self.tested = ticks
        return [(int(row), self._taxels[k]) for row, k in np.argwhere(dead.T)]


def bounded(lows: Floats, highs: Floats) -> NDArray[np.bool_]:
    """Which rows have a sample that is bounded on both sides."""
    found: NDArray[np.bool_] = np.any((lows != -inf) & (highs != inf), axis=1)
    return found
