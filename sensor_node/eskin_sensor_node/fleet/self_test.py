"""The self-test of a cohort's taxels: the twin of `node.self_test`."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.fleet.report_kernels import GONE
from eskin_sensor_node.node.self_test import SELF_TEST_WINDOW

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.fleet.roster import Roster


class CohortSelfTest:
    """Finds taxels whose line is certainly open, each once in a boot.

    Only a design without neighbours samples in columns, so that none is ever certainly stuck.

    Args:
        roster: Remembers which are dead.
        numbers: Which of its nodes, a row each; `GONE` where one has left.
        since: Ticks at which the first window begins.

    Attributes:
        tested: Ticks at which the window begins.
    """

    def __init__(self, roster: Roster, numbers: NDArray[np.int64], *, since: int) -> None:
        taxels = len(roster.settings.taxel)
        self._roster = roster
        self._numbers = numbers
        self._seen = np.zeros(taxels, bool)
        self._bounded = np.zeros((taxels, len(numbers)), bool)
        self.tested = since

    def take(self, taxel: int, bounded: NDArray[np.bool_]) -> None:
        """Take a frame in: at which nodes a sample of it was bounded."""
        self._seen[taxel] = True
        self._bounded[taxel] |= bounded

    def examine(self, ticks: int) -> list[tuple[int, int]]:
        """Where a window ends at some ticks: nodes and their taxels that are certainly dead."""
        if ticks - self.tested < SELF_TEST_WINDOW:
            return []
        here, dead = self._numbers != GONE, self._roster.dead
        found = self._seen[:, None] & ~self._bounded & ~dead[:, self._numbers] & here
        broken = [(int(self._numbers[row]), int(k)) for row, k in np.argwhere(found.T)]
        for number, k in broken:
            dead[k, number] = True
        self._seen[:], self._bounded[:] = False, False
        self.tested = ticks
        return broken


def bounded(lows: Floats, highs: Floats) -> NDArray[np.bool_]:
    """Which rows have a sample that is bounded on both sides."""
    found: NDArray[np.bool_] = np.any((lows != -inf) & (highs != inf), axis=1)
    return found
