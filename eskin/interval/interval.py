"""Intervals: arrays of closed bounds ``[lo, hi]`` that enclose the truth.

Names and results are those of IEEE 1788-2015, set-based flavour: a function is evaluated where it
is defined, so the square root of ``[-4, -1]`` is empty; an unbounded side is an infinity, and
``[-inf, inf]`` says that nothing is known. Every operation rounds outward.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from eskin.errors import IntervalError
from eskin.interval.answer import Answer
from eskin.interval.printing import text_of
from eskin.interval.reductions import Reductions

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from eskin.interval.bounds import Bounds


class Interval(Reductions):
    """An array of closed intervals.

    Behaves as a numpy array of numbers does: it is broadcast, indexed and calculated with, and
    numpy's own functions (``np.sqrt(x)``, ``np.add(x, y)``) take it. Comparisons give an `Answer`
    of three values. The arrays of bounds are shared with whoever gave them and not to be changed.

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

    def __lt__(self, other: Bounds | ArrayLike) -> Answer:
        that = self._compared(other)
        return Answer(self.sup < that.inf, self.inf >= that.sup)

    def __le__(self, other: Bounds | ArrayLike) -> Answer:
        that = self._compared(other)
        return Answer(self.sup <= that.inf, self.inf > that.sup)

    def __gt__(self, other: Bounds | ArrayLike) -> Answer:
        return ~(self <= other)

    def __ge__(self, other: Bounds | ArrayLike) -> Answer:
        return ~(self < other)

    def __eq__(self, other: object) -> Answer:  # type: ignore[override]  # three values, as an array's many
        that = self._compared(other)
        same = self.is_singleton & that.is_singleton & (self.inf == that.inf)
        return Answer(same, self.disjoint(that))

    def __ne__(self, other: object) -> Answer:  # type: ignore[override]  # three values, as `==`
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
        return f"Interval(lo={self.inf!r}, hi={self.sup!r})"

    def __str__(self) -> str:
        return text_of(self, "")

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
        if function not in _FUNCTIONS:
            raise IntervalError(
                f"numpy's {function.__name__} is not defined for intervals; take .inf, .sup or .mid"
            )
        return _FUNCTIONS[function](*inputs, **options)


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
_FUNCTIONS: Final[dict[Any, Callable[..., Any]]] = {
    np.sum: Interval.sum,
    np.mean: Interval.mean,
    np.min: Interval.min,
    np.amin: Interval.min,
    np.max: Interval.max,
    np.amax: Interval.max,
    np.stack: Interval.stack,
    np.concatenate: Interval.concatenate,
    np.reshape: Interval.reshape,
    np.ravel: Interval.ravel,
    np.shape: lambda x: x.shape,
    np.ndim: lambda x: x.ndim,
    np.size: lambda x: x.size,
}
