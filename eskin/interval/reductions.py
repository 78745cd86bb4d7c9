"""Many intervals made one: along axes, as numpy's reductions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias, TypeGuard

import numpy as np

from eskin.errors import IntervalError
from eskin.interval.conversion import as_compiled
from eskin.interval.sets import Sets
from eskin.kernels import summation
from eskin.kernels.rounding_mode import rounding_to_nearest

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eskin.interval.bounds import Bounds

Axes: TypeAlias = "int | tuple[int, ...] | None"
_NEIGHBOURS: Final = (slice(1, None), slice(None, -1))


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

    @rounding_to_nearest
    def cumsum(self, axis: int | None = None) -> Self:
        """The sum up to each, along an axis or of all; as tight as `sum`."""
        if axis is None:
            return self.ravel().cumsum(0)
        rows, shape, place = self._lines(axis)
        out = np.empty((2, *rows.shape))
        summation.running_sums(rows.inf, rows.sup, out[0], out[1])
        lo, hi = np.moveaxis((out + 0.0).reshape(2, *shape), -1, place + 1)
        return self._trusted(lo, hi)

    def prod(self, axis: Axes = None, *, keepdims: bool = False) -> Self:
        """The product of all, or along axes: half with half, so that few roundings add up."""
        rows, shape = self._rows(axis, keepdims=keepdims)
        left = rows if rows.shape[1] else self.of(np.ones((rows.shape[0], 1)))
        while (n := left.shape[1]) > 1:
            halves = left[:, : n // 2] * left[:, n // 2 : 2 * (n // 2)]
            left = self.concatenate([halves, left[:, 2 * (n // 2) :]], axis=1)
        return left.reshape(shape)

    def diff(self, n: int = 1, axis: int = -1) -> Self:
        """What each is less than the next along an axis, n times."""
        if n < 0:
            raise IntervalError(f"diff is taken 0 times or more, not {n}")
        place = self._places(axis)[0]
        ahead, behind = ((slice(None),) * place + (part,) for part in _NEIGHBOURS)
        found = self
        for _ in range(n):
            found = found[ahead] - found[behind]
        return found

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
        along = self._places(axis)
        rest = [each for each in range(self.ndim) if each not in along]
        kept = tuple(self.shape[each] for each in rest)
        lengths = (int(np.prod(kept)), int(np.prod([self.shape[each] for each in along])))
        lo, hi = (
            as_compiled(side.transpose(*rest, *along)).reshape(lengths)
            for side in (self.inf, self.sup)
        )
        whole = tuple(1 if each in along else n for each, n in enumerate(self.shape))
        return self._trusted(lo, hi), (whole if keepdims else kept)

    def _lines(self, axis: int) -> tuple[Self, tuple[int, ...], int]:
        """The intervals line by line along an axis, their shape before, and the axis' place."""
        place = self._places(axis)[0]
        lo, hi = (np.moveaxis(side, place, -1) for side in (self.inf, self.sup))
        lines = (math.prod(lo.shape[:-1]), lo.shape[-1])
        rows = self._trusted(as_compiled(lo).reshape(lines), as_compiled(hi).reshape(lines))
        return rows, lo.shape, place

    def _places(self, axis: Axes) -> tuple[int, ...]:
        wanted = range(self.ndim) if axis is None else np.atleast_1d(axis).tolist()
        try:
            return np.lib.array_utils.normalize_axis_tuple(wanted, self.ndim)
        except ValueError as error:
            raise IntervalError(f"axis {axis!r} of shape {self.shape}: {error}") from error


def _is_operand(other: Bounds | ArrayLike | None) -> TypeGuard[Bounds | ArrayLike]:
    return other is not None and not isinstance(other, int | np.integer | tuple)


def _axes(first: Any, axis: Axes) -> Axes:
    return axis if first is None else first
