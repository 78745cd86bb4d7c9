"""The self-test of a cohort's taxels: that of a skin, whose columns are each node's taxels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.columns.self_test import ColumnsSelfTest
from eskin_sensor_node.firmware.selftest import CERTAIN
from eskin_sensor_node.fleet.report_kernels import GONE
from eskin_sensor_node.node.self_test import SELF_TEST_WINDOW
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR

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
        self._roster = roster
        self._numbers = numbers
        self._shape = len(roster.settings.taxel), len(numbers)
        columns = self._shape[0] * self._shape[1]
        alone = np.full((columns, 1), NO_NEIGHBOUR)
        self._columns = ColumnsSelfTest(np.zeros((columns, 1)), alone)
        self.tested = since

    def take(self, taxel: int, lows: Floats, highs: Floats) -> None:
        """Take a frame of a taxel: bounds of its first quantity, nodes × samples."""
        self._columns.take(lows, highs, first=taxel * self._shape[1])

    def examine(self, ticks: int) -> list[tuple[int, int]]:
        """Where a window ends at some ticks: nodes and their taxels that are certainly dead."""
        if ticks - self.tested < SELF_TEST_WINDOW:
            return []
        here, dead = self._numbers != GONE, self._roster.dead
        certain = self._columns.examine()[0].reshape(self._shape) == CERTAIN
        found = certain & ~dead[:, self._numbers] & here
        broken = [(int(self._numbers[row]), int(k)) for row, k in np.argwhere(found.T)]
        for number, k in broken:
            dead[k, number] = True
        self.tested = ticks
        return broken
