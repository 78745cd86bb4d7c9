"""Many intervals made one: along axes, as numpy's reductions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self, TypeAlias, TypeGuard

import numpy as np

from eskin.errors import IntervalError
from eskin.interval.sets import Sets
from eskin.kernels import summation
from eskin.kernels.rounding_mode import rounding_to_nearest

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eskin.interval.bounds import Bounds

Axes: TypeAlias = "int | tuple[int, ...] | None"


class Reductions(Sets):
    """Sums, means, least and greatest."""

    __slots__ = ()

    @rounding_to_nearest
    def sum(self, axis: Axes = None, *, keepdims: bool = False) -> Self:
        """The sum of all, or along axes; as tight as if it were rounded once or twice."""
        rows, shape = self._rows(axis, keepdims=keepdims)
        out = np.empty((2, rows.shape[0]))
        summation.sums(rows.inf, rows.sup, out[0], out[1])
        return self._trusted(*(out + 0.0).reshape(2, *shape))

    def mean(self, axis: Axes = None, *, keepdims: bool = False) -> Self:
        """The mean of all, or along axes; empty of nothing."""
        total = self.sum(axis, keepdims=keepdims)
        return total / (self.size // max(total.size, 1))

    def min(
        self, other: Bounds | ArrayLike | None = None, *, axis: Axes = None, keepdims: bool = False
    ) -> Self:
        """The least number, one of each, of all or along axes; or with another, the lesser of two.

        A whole number or a tuple in the first place is the axis, as in numpy; an interval, an array
        or a float is the other operand. ``np.minimum`` takes operands of every kind.
        """
        if _is_operand(other):
            return self.lesser(other)
        rows, shape = self._rows(_axes(other, axis), keepdims=keepdims)
        if rows.shape[1] == 0:
            raise IntervalError(f"shape {self.shape} along axis {axis}: no intervals, no least one")
        empty = np.any(rows.is_empty, axis=1)
        lo = np.where(empty, np.inf, rows.inf.min(axis=1))
        hi = np.where(empty, -np.inf, rows.sup.min(axis=1))
        return self._trusted(lo.reshape(shape), hi.reshape(shape))

    def max(
        self, other: Bounds | ArrayLike | None = None, *, axis: Axes = None, keepdims: bool = False
    ) -> Self:
        """The greatest number, one of each, of all or along axes; or of two: see `min`."""
        if _is_operand(other):
            return self.greater(other)
        return -(-self).min(axis=_axes(other, axis), keepdims=keepdims)

    def _rows(self, axis: Axes, *, keepdims: bool) -> tuple[Self, tuple[int, ...]]:
        """What is reduced along the second axis, and the shape of the result."""
        wanted = range(self.ndim) if axis is None else np.atleast_1d(axis).tolist()
        try:
            along = np.lib.array_utils.normalize_axis_tuple(wanted, self.ndim)
        except ValueError as error:
            raise IntervalError(f"axis {axis!r} of shape {self.shape}: {error}") from error
        rest = [each for each in range(self.ndim) if each not in along]
        kept = tuple(self.shape[each] for each in rest)
        lengths = (int(np.prod(kept)), int(np.prod([self.shape[each] for each in along])))
        lo, hi = (
            np.ascontiguousarray(side.transpose(*rest, *along)).reshape(lengths)
            for side in (self.inf, self.sup)
        )
        whole = tuple(1 if each in along else n for each, n in enumerate(self.shape))
        return self._trusted(lo, hi), (whole if keepdims else kept)


def _is_operand(other: Bounds | ArrayLike | None) -> TypeGuard[Bounds | ArrayLike]:
    return other is not None and not isinstance(other, int | np.integer | tuple)


def _axes(first: Any, axis: Axes) -> Axes:
    return axis if first is None else first
