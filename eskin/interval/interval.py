"""Intervals: arrays of closed bounds ``[lo, hi]`` that enclose the truth.

Names and results are those of IEEE 1788-2015, set-based flavour: a function is evaluated where it
is defined, so the square root of ``[-4, -1]`` is empty; an unbounded side is an infinity, and
``[-inf, inf]`` says that nothing is known. Every operation rounds outward.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import frames
from eskin.interval.format import format_up, text_of
from eskin.interval.markup import html_table, html_text
from eskin.interval.reductions import Reductions
from eskin.interval.verdict import NUMPY_FUNCTIONS, Verdicts, call_numpy

if TYPE_CHECKING:
    from collections.abc import Callable

    import pandas as pd
    import xarray as xr
    from numpy.typing import ArrayLike

    from eskin.interval.bounds import Bounds
    from eskin.interval.conversion import Floats


class Interval(Reductions):
    """An array of closed intervals.

    Behaves as a numpy array of numbers does: it is broadcast, indexed and calculated with, and
    numpy's own functions (``np.sqrt(x)``, ``np.add(x, y)``) take it. Comparisons give
    `Verdicts`. The caller must not change the arrays of bounds, which are not copied.

    Args:
        lo: Lower bounds; or the numbers themselves, if ``hi`` is left out. What no float can hold
            exactly (2⁵³ + 1, a long double) is rounded outward.
        hi: Upper bounds.

    Attributes:
        inf: Lower bounds, float64, any shape; ``inf`` for the empty interval.
        sup: Upper bounds, the same shape; ``-inf`` for the empty interval.

    Raises:
        IntervalError: A bound is NaN or no real number, ``lo > hi``, or the shapes do not fit.
    """

    __slots__ = ()
    __hash__ = None  # type: ignore[assignment]  # intervals are arrays: equal to nothing as a key

    @classmethod
    def around(cls, value: ArrayLike, radius: ArrayLike) -> Self:
        """``[value - radius, value + radius]``, rounded outward.

        Raises:
            IntervalError: A radius is negative, or no number.
        """
        reach = cls(radius)
        if np.any(reach.inf < 0.0):
            raise IntervalError(f"radius {radius!r} is negative")
        return cls(value) + cls._trusted(-reach.sup, reach.sup)

    @classmethod
    def relative(cls, value: ArrayLike, tolerance: ArrayLike) -> Self:
        """``value · [1 - tolerance, 1 + tolerance]``, rounded outward: a part's data sheet."""
        return cls(value) * cls.around(1.0, tolerance)

    def __lt__(self, other: Bounds | ArrayLike) -> Verdicts:
        that = self._compared(other)
        return Verdicts(self.sup < that.inf, self.inf >= that.sup)

    def __le__(self, other: Bounds | ArrayLike) -> Verdicts:
        that = self._compared(other)
        return Verdicts(self.sup <= that.inf, self.inf > that.sup)

    def __gt__(self, other: Bounds | ArrayLike) -> Verdicts:
        return ~(self <= other)

    def __ge__(self, other: Bounds | ArrayLike) -> Verdicts:
        return ~(self < other)

    def __eq__(self, other: object) -> Verdicts:  # type: ignore[override]  # three values, as an array's many
        that = self._compared(other)
        same = self.is_singleton & that.is_singleton & (self.inf == that.inf)
        return Verdicts(same, self.disjoint(that))

    def __ne__(self, other: object) -> Verdicts:  # type: ignore[override]  # three values, as `==`
        return ~(self == other)

    def _compared(self, other: Any) -> Self:
        that = self.of(other)
        for each in (self, that):
            each.require(~each.is_empty, "an empty interval compares with nothing")
        return that

    def __contains__(self, value: ArrayLike) -> bool:
        return bool(np.all(self.contains(value)))

    def __repr__(self) -> str:
        if self.ndim == 0:
            if self.is_empty:
                return "Interval.empty()"
            return f"Interval({float(self.inf)!r}, {float(self.sup)!r})"
        with np.printoptions(floatmode="unique"):
            return f"Interval(lo={self.inf!r}, hi={self.sup!r})"

    def __str__(self) -> str:
        return text_of(self, "")

    def to_pandas(self) -> pd.DataFrame:
        """Columns ``lo`` and ``hi``, a row for each interval of one axis; NaN where all is missing.

        Raises:
            IntervalError: It has not one axis.
            MissingExtraError: pandas is not installed.
        """
        return frames.to_pandas(self)

    @classmethod
    def from_pandas(cls, frame: pd.DataFrame) -> Interval:
        """The intervals of columns ``lo`` and ``hi``, unbounded where one is missing.

        Raises:
            IntervalError: A column is missing, or holds what is no interval.
        """
        return cls._from_sides(*frames.sides_of_frame(frame))

    def to_xarray(self) -> xr.Dataset:
        """Variables ``lo`` and ``hi`` of the same axes; NaN where all is missing.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        return frames.to_xarray(self)

    @classmethod
    def from_xarray(cls, data: xr.Dataset) -> Interval:
        """The intervals of variables ``lo`` and ``hi``, unbounded where one is missing.

        Raises:
            IntervalError: A variable is missing, or holds what is no interval.
        """
        return cls._from_sides(*frames.sides_of_dataset(data))

    @classmethod
    def _from_sides(cls, lo: Floats, hi: Floats) -> Interval:
        empty = (lo == np.inf) & (hi == -np.inf)
        made = Interval(np.where(empty, 0.0, lo), np.where(empty, 0.0, hi))
        return Interval.where(empty, Interval.empty(), made)

    def _repr_html_(self) -> str:
        if self.ndim != 1:
            return html_text(str(self))
        return html_table(
            f"{self.size} intervals",
            ["", "interval", "width"],
            self.size,
            lambda k: [str(k), str(self[k]), format_up(float(self[k].wid))],
        )

    def __format__(self, spec: str) -> str:
        return text_of(self, spec)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options or ufunc not in _UFUNCS:
            name = getattr(ufunc, "__name__", str(ufunc))
            call = name if method == "__call__" else f"{name}.{method}"
            raise IntervalError(
                f"numpy's {call} is not defined for intervals"
                + (f" with {', '.join(options)}" if options else "")
                + "; take .inf, .sup or .mid"
            )
        return _UFUNCS[ufunc](type(self).of(inputs[0]), *inputs[1:])

    def __array_function__(self, function: Any, _: Any, inputs: Any, options: Any) -> Any:
        return call_numpy(function, inputs, options)


def as_interval(value: Interval | ArrayLike) -> Interval:
    """The interval itself, or the least one around a plain number or array."""
    return Interval.of(value)


_UFUNCS: Final[dict[Any, Callable[..., Any]]] = {
    np.add: Interval.__add__,
    np.subtract: Interval.__sub__,
    np.multiply: Interval.__mul__,
    np.divide: Interval.__truediv__,
    np.power: Interval.__pow__,
    np.negative: Interval.__neg__,
    np.positive: Interval.__pos__,
    np.absolute: Interval.__abs__,
    np.reciprocal: Interval.recip,
    np.square: Interval.sqr,
    np.sqrt: Interval.sqrt,
    np.cbrt: Interval.cbrt,
    np.hypot: Interval.hypot,
    np.sign: Interval.sign,
    np.ceil: Interval.ceil,
    np.floor: Interval.floor,
    np.trunc: Interval.trunc,
    np.rint: Interval.round_ties_to_even,
    np.exp: Interval.exp,
    np.exp2: Interval.exp2,
    np.expm1: Interval.expm1,
    np.log: Interval.log,
    np.log2: Interval.log2,
    np.log10: Interval.log10,
    np.log1p: Interval.log1p,
    np.sin: Interval.sin,
    np.cos: Interval.cos,
    np.tan: Interval.tan,
    np.arcsin: Interval.asin,
    np.arccos: Interval.acos,
    np.arctan: Interval.atan,
    np.arctan2: Interval.atan2,
    np.sinh: Interval.sinh,
    np.cosh: Interval.cosh,
    np.tanh: Interval.tanh,
    np.arcsinh: Interval.asinh,
    np.arccosh: Interval.acosh,
    np.arctanh: Interval.atanh,
    np.minimum: Interval.lesser,
    np.maximum: Interval.greater,
    np.less: Interval.__lt__,
    np.less_equal: Interval.__le__,
    np.greater: Interval.__gt__,
    np.greater_equal: Interval.__ge__,
    np.equal: Interval.__eq__,
    np.not_equal: Interval.__ne__,
}


def _clip(
    x: Interval | ArrayLike,
    a_min: Interval | ArrayLike | None = None,
    a_max: Interval | ArrayLike | None = None,
    *,
    min: Interval | ArrayLike | None = None,  # noqa: A002 - numpy's name
    max: Interval | ArrayLike | None = None,  # noqa: A002 - likewise
) -> Interval:
    """`numpy.clip`, which has two names for each limit."""
    return Interval.of(x).clip(a_min if min is None else min, a_max if max is None else max)


NUMPY_FUNCTIONS.update(
    {
        np.sum: Interval.sum,
        np.mean: Interval.mean,
        np.min: Interval.min,
        np.amin: Interval.min,
        np.max: Interval.max,
        np.amax: Interval.max,
        np.cumsum: Interval.cumsum,
        np.prod: Interval.prod,
        np.diff: Interval.diff,
        np.where: Interval.where,
        np.clip: _clip,
        np.stack: Interval.stack,
        np.concatenate: Interval.concatenate,
        np.reshape: Interval.reshape,
        np.ravel: Interval.ravel,
        np.ndim: lambda x: x.ndim,
        np.size: lambda x: x.size,
    }
)
