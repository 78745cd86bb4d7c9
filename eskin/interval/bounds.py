"""An array of bounds: what intervals have from being arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from eskin.errors import IntervalError
from eskin.interval.conversion import enclose, first_index, require_order

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

    from eskin.interval.conversion import Floats


class Bounds:
    """Lower and upper bounds, shape and indexing.

    Attributes:
        inf: Lower bounds, float64, any shape; ``inf`` for the empty interval.
        sup: Upper bounds, the same shape; ``-inf`` for the empty interval.
    """

    __slots__ = ("inf", "sup")
    inf: Floats
    sup: Floats

    def __init__(self, lo: ArrayLike, hi: ArrayLike | None = None) -> None:
        inf, top = enclose(lo, "lo")
        sup = top if hi is None else enclose(hi, "hi")[1]
        if inf.shape != sup.shape:
            try:
                shape = np.broadcast_shapes(inf.shape, sup.shape)
            except ValueError as error:
                raise IntervalError(f"lo and hi do not fit each other: {error}") from error
            inf, sup = np.broadcast_to(inf, shape), np.broadcast_to(sup, shape)
        require_order(inf, sup)
        self.inf = inf
        self.sup = sup

    @classmethod
    def _trusted(cls, inf: Floats, sup: Floats) -> Self:
        made = cls.__new__(cls)
        made.inf = np.asarray(inf)
        made.sup = np.asarray(sup)
        return made

    @classmethod
    def empty(cls, shape: int | tuple[int, ...] = ()) -> Self:
        """Intervals without members."""
        return cls._trusted(np.full(shape, np.inf), np.full(shape, -np.inf))

    @classmethod
    def entire(cls, shape: int | tuple[int, ...] = ()) -> Self:
        """Intervals of all real numbers: nothing is known."""
        return cls._trusted(np.full(shape, -np.inf), np.full(shape, np.inf))

    @classmethod
    def stack(cls, parts: Sequence[Bounds], axis: int = 0) -> Self:
        """Join intervals of one shape along a new axis, as `numpy.stack` does."""
        return cls._joined(np.stack, parts, axis)

    @classmethod
    def concatenate(cls, parts: Sequence[Bounds], axis: int = 0) -> Self:
        """Join intervals along an axis that they have, as `numpy.concatenate` does."""
        return cls._joined(np.concatenate, parts, axis)

    @classmethod
    def _joined(cls, join: Callable[..., Any], parts: Sequence[Bounds], axis: int) -> Self:
        try:
            return cls._trusted(
                join([part.inf for part in parts], axis=axis),
                join([part.sup for part in parts], axis=axis),
            )
        except ValueError as error:
            raise IntervalError(f"these intervals do not join: {error}") from error

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array of intervals."""
        return self.inf.shape

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return self.inf.ndim

    @property
    def size(self) -> int:
        """Number of intervals."""
        return self.inf.size

    @property
    def dtype(self) -> np.dtype[np.float64]:
        """What the bounds are: float64."""
        return self.inf.dtype

    @property
    def T(self) -> Self:  # noqa: N802 - numpy's name
        """Axes in reverse order."""
        return self._trusted(self.inf.T, self.sup.T)

    def __len__(self) -> int:
        if self.ndim == 0:
            raise TypeError("a single interval has no length")
        return len(self.inf)

    def __iter__(self) -> Iterator[Self]:
        for index in range(len(self)):
            yield self[index]

    def __getitem__(self, index: Any) -> Self:
        return self._trusted(self.inf[index], self.sup[index])

    def reshape(self, *shape: int | tuple[int, ...]) -> Self:
        """The same intervals in another shape, given as numbers or as a tuple."""
        wanted: Any = shape[0] if len(shape) == 1 else shape
        return self._trusted(self.inf.reshape(wanted), self.sup.reshape(wanted))

    def ravel(self) -> Self:
        """The same intervals along one axis."""
        return self._trusted(self.inf.ravel(), self.sup.ravel())

    def copy(self) -> Self:
        """Intervals with arrays of their own."""
        return self._trusted(self.inf.copy(), self.sup.copy())

    def __array__(self, *_: Any, **__: Any) -> NDArray[Any]:
        raise IntervalError(
            "an interval is not one array of numbers: take its .inf, .sup or .mid; join intervals "
            "with Interval.stack"
        )

    def require(self, holds: NDArray[np.bool_], what: str) -> None:
        """Check something of each interval.

        Raises:
            IntervalError: It does not hold everywhere; the message states where and of which.
        """
        if not np.all(holds):
            where = first_index(~np.asarray(holds))
            shown = self[where] if self.ndim else self
            raise IntervalError(f"{what}; at index {where}: {shown}")
