"""The clocks of some nodes that started together, in columns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.firmware.clock import Clock as FirmwareClock
from eskin_sensor_node.machine.clock import Crystal, clock_generator, draw_offsets

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


class Clocks:
    """Draws for each node what `node.factory.build_clock` draws for one.

    Args:
        starts: True UTC at tick 0 of each node, ns.
        seeds: Of the nodes.
        boots: Likewise.
        error: Bound of the real-time clocks' errors, ns.
        drift: Bound of the crystals' rate errors, in parts of 1e9.
    """

    def __init__(
        self,
        starts: NDArray[np.int64],
        seeds: NDArray[np.uint64],
        boots: NDArray[np.int64],
        *,
        error: int,
        drift: int,
    ) -> None:
        self.error = error
        self.drift = drift
        self._starts, self._seeds, self._boots = starts, seeds, boots
        random = clock_generator(seeds)
        self._crystal = Crystal(drift, random)
        self.readings = starts + draw_offsets(error, random, boots)

    def beside(self, rows: Sequence[int]) -> Clocks:
        """Those of some nodes."""
        drawn = self._starts[rows], self._seeds[rows], self._boots[rows]
        return Clocks(*drawn, error=self.error, drift=self.drift)

    def known(self, row: int) -> FirmwareClock:
        """What the firmware of one node knows."""
        return FirmwareClock(int(self.readings[row]), self.error, self.drift)

    def elapsed(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """True ns since the start, nodes × ticks."""
        return self._crystal.elapsed(ticks)

    def true_times(self, ticks: int) -> list[int]:
        """True UTC in ns of each node; for the audit, not for the firmware."""
        times: list[int] = (self._starts + self.elapsed(np.array([ticks]))[:, 0]).tolist()
        return times
