"""The clocks of some nodes that started together, in columns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.firmware.clock import Clock as FirmwareClock
from eskin_sensor_node.fleet.stacking import stacked
from eskin_sensor_node.machine.clock import Crystal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


class Clocks:
    """Draws for each node what `node.factory.build_clock` draws for one.

    Args:
        starts: True UTC at tick 0 of each node, ns.
        randoms: Draw crystals and errors, one generator for each.
        error: Bound of the real-time clocks' errors, ns.
        drift: Bound of the crystals' rate errors, in parts of 1e9.
    """

    def __init__(
        self,
        starts: Sequence[int],
        randoms: Sequence[np.random.Generator],
        *,
        error: int,
        drift: int,
    ) -> None:
        self.error = error
        self.drift = drift
        self.starts = np.array(starts, np.int64)
        self._crystals = [Crystal(drift, random) for random in randoms]
        offsets = [int(random.integers(-error, error, endpoint=True)) for random in randoms]
        self.readings = self.starts + np.array(offsets, np.int64)

    def beside(self, rows: Sequence[int]) -> ClockColumn:
        """Those of some nodes."""
        return ClockColumn(self.starts[rows], stacked([self._crystals[row] for row in rows]))

    def known(self, row: int) -> FirmwareClock:
        """What the firmware of one node knows."""
        return FirmwareClock(int(self.readings[row]), self.error, self.drift)


class ClockColumn:
    """Clocks of some nodes, without the firmware's knowledge.

    Args:
        starts: True UTC at tick 0 of each node, ns.
        crystal: Theirs, in a column.
    """

    def __init__(self, starts: NDArray[np.int64], crystal: Crystal) -> None:
        self._starts = starts
        self._crystal = crystal

    def elapsed(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """True ns since the start, nodes × ticks."""
        found = self._crystal.elapsed(ticks)
        return np.broadcast_to(found, (len(self._starts), found.shape[-1]))

    def true_times(self, ticks: int) -> list[int]:
        """True UTC in ns of each node; for the audit, not for the firmware."""
        times: list[int] = (self._starts + self.elapsed(np.array([ticks]))[:, 0]).tolist()
        return times
