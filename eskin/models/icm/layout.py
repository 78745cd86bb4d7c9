"""Parameters and times of any shapes, as the rows and columns that the ICM's kernels work on.

A row has one set of parameters and many times: a taxel. The longest axis along which no parameter
varies becomes the columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eskin.interval.conversion import as_compiled
from eskin.models.broadcasting import broadcast_shape
from eskin.models.parameters import FINITE, thin

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from eskin.models.parameters import Floats, Parameter


@dataclass(frozen=True, slots=True)
class KernelLayout:
    """Work for a kernel.

    Attributes:
        rows: Bounds of each parameter in turn (inf, sup, inf, …), one row for each taxel.
        clock_of: For each row the row of ``times``.
        times: Rows of times in s.
        shape: Shape of the result with the columns' axis moved to the end.
        axis: Where that axis belongs; ``None`` where it was added.
    """

    rows: Floats
    clock_of: NDArray[np.int64]
    times: Floats
    shape: tuple[int, ...]
    axis: int | None

    def restore(self, bound: Floats) -> Floats:
        """Give rows × columns the broadcast shape of the inputs."""
        full = bound.reshape(self.shape)
        return full[..., 0] if self.axis is None else np.moveaxis(full, -1, self.axis)


def lay_out(time: ArrayLike, parameters: Sequence[Parameter]) -> KernelLayout:
    """Arrange times and checked parameters.

    Raises:
        IntervalError: A value is not allowed, or shapes do not fit each other.
    """
    clock = thin("time", time, FINITE)
    shape = broadcast_shape([clock, *parameters])
    for each in (clock, *parameters):
        each.require_allowed()
    bounds = [_padded(b, shape) for p in parameters for b in (p.inf, p.sup)]
    times = _padded(clock.inf, shape)
    free = [k for k in range(len(shape)) if all(b.shape[k] == 1 for b in bounds)]
    axis = max(free, key=lambda k: shape[k]) if free else None
    if axis is None:
        bounds, times, shape = [b[..., None] for b in bounds], times[..., None], (*shape, 1)
    else:
        bounds = [np.moveaxis(b, axis, -1) for b in bounds]
        times = np.moveaxis(times, axis, -1)
        shape = (*shape[:axis], *shape[axis + 1 :], shape[axis])
    lead = shape[:-1]
    rows = np.empty((math.prod(lead), len(bounds)))
    for k, bound in enumerate(bounds):
        rows[:, k] = np.broadcast_to(bound[..., 0], lead).reshape(-1)
    clocks = np.arange(math.prod(times.shape[:-1])).reshape(times.shape[:-1])
    clock_of = np.broadcast_to(clocks, lead).reshape(-1).astype(np.int64)
    wide = np.broadcast_to(times, (*times.shape[:-1], shape[-1]))
    return KernelLayout(
        rows, clock_of, as_compiled(wide).reshape(clocks.size, shape[-1]), shape, axis
    )


def _padded(array: Floats, shape: tuple[int, ...]) -> Floats:
    return array.reshape((1,) * (len(shape) - array.ndim) + array.shape)
