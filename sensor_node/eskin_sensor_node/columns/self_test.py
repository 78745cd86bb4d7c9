"""The self-test of a skin: the firmware's, in columns."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.jit import kernel
from eskin_sensor_node.firmware.selftest import CERTAIN, IMPOSSIBLE, POSSIBLE, STILL
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.world.skin.skin import Indices

    Verdicts = NDArray[np.int64]

AROUND: Final = 4
"""So many surround a taxel: no contact moves all of them and leaves it out."""
_BOUNDED, _UNBOUNDED, _WIDTH, _LEAST_LO, _MOST_LO, _LEAST_HI, _MOST_HI = range(7)
_EMPTY: Final = (0.0, 0.0, 0.0, inf, -inf, inf, -inf)
_down, _up = compiled_inversion().down, compiled_inversion().up


@kernel
def _take(lows: Floats, highs: Floats, windows: Floats) -> None:
    """`eskin_sensor_node.firmware.selftest.BoundsWindow.take`, column by column."""
    for column in range(lows.shape[0]):
        window = windows[column]
        for k in range(lows.shape[1]):
            lo, hi = lows[column, k], highs[column, k]
            if lo == -inf or hi == inf:
                window[_UNBOUNDED] += 1.0
                continue
            window[_BOUNDED] += 1.0
            window[_WIDTH] = max(window[_WIDTH], _up(hi - lo))
            window[_LEAST_LO] = min(window[_LEAST_LO], lo)
            window[_MOST_LO] = max(window[_MOST_LO], lo)
            window[_LEAST_HI] = min(window[_LEAST_HI], hi)
            window[_MOST_HI] = max(window[_MOST_HI], hi)


@kernel
def _moved(windows: Floats, least: Floats, most: Floats) -> None:
    """Bounds of the range of the true values of each column."""
    for column in range(windows.shape[0]):
        window = windows[column]
        least[column], most[column] = 0.0, inf
        if window[_BOUNDED] == 0.0:
            continue
        least[column] = max(0.0, _down(window[_MOST_LO] - window[_LEAST_HI]))
        if window[_UNBOUNDED] == 0.0:
            most[column] = _up(window[_MOST_HI] - window[_LEAST_LO])


class ColumnsSelfTest:
    """Finds stuck and dead taxels; the twin of `eskin_sensor_node.firmware.selftest.SelfTest`.

    Args:
        positions: Where the columns are, shape ``(columns, axes)``.
        neighbours: Columns that sit beside each, padded with `NO_NEIGHBOUR`.
    """

    def __init__(self, positions: Floats, neighbours: Indices) -> None:
        self._around = nearest(positions, neighbours)
        self._windows = np.tile(np.array(_EMPTY), (len(positions), 1))

    def take(self, lows: Floats, highs: Floats, first: int = 0) -> None:
        """Take samples of one quantity, columns × rows, always of the same one.

        Args:
            lows: Their lower bounds.
            highs: Their upper bounds.
            first: The first of the columns.
        """
        _take(lows, highs, self._windows[first : first + len(lows)])

    def examine(self) -> tuple[Verdicts, Verdicts]:
        """Whether each column is dead and whether it is stuck; then a new window begins."""
        windows = self._windows
        count, unbounded, width = windows[:, :3].T.copy()
        least, most = np.empty(len(windows)), np.empty(len(windows))
        _moved(windows, least, most)
        windows[:] = _EMPTY
        dead = np.where(unbounded == 0.0, IMPOSSIBLE, np.where(count > 0.0, POSSIBLE, CERTAIN))
        living, lively = count > 0.0, least > width
        around = self._around
        alive = (around != NO_NEIGHBOUR) & living[around]
        moved = np.all(~alive | lively[around], axis=1) & np.any(alive, axis=1)
        still = living & (most <= (1.0 + STILL) * width)
        stuck = np.where(least > 0.0, IMPOSSIBLE, np.where(still & moved, CERTAIN, POSSIBLE))
        return dead.astype(np.int64), stuck.astype(np.int64)


def nearest(positions: Floats, neighbours: Indices) -> Indices:
    """The four nearest columns of each, among its neighbours and theirs: ``(columns, 4)``.

    Args:
        positions: Shape ``(columns, axes)``.
        neighbours: Columns, shape ``(columns, most)``, padded with `NO_NEIGHBOUR`.
    """
    count = len(positions)
    padded = np.concatenate([neighbours, np.full((1, neighbours.shape[1]), NO_NEIGHBOUR)])
    found = np.concatenate([neighbours, padded[neighbours].reshape(count, -1)], axis=1)
    found[found == np.arange(count)[:, None]] = NO_NEIGHBOUR
    found.sort(axis=1)
    found[:, 1:][found[:, 1:] == found[:, :-1]] = NO_NEIGHBOUR
    far = np.linalg.norm(positions[found] - positions[:, None, :], axis=2)
    far[found == NO_NEIGHBOUR] = inf
    order = np.argsort(far, axis=1, kind="stable")[:, :AROUND]
    chosen = np.take_along_axis(found, order, axis=1)
    missing = AROUND - chosen.shape[1]
    return np.pad(chosen, ((0, 0), (0, max(missing, 0))), constant_values=NO_NEIGHBOUR)
