"""Intervals with their partial derivatives: automatic differentiation, forward mode.

A `Dual` runs through any formula of ``+ - * /``, integer powers and numpy's ``sqrt``, ``exp``,
``log``, ``sin`` and ``cos``. Its partial derivatives enclose those at every point of the box (Rall
1981; Moore, Kearfott and Cloud 2009, section 6.4).
"""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, Any, Final, SupportsIndex

import numpy as np

from eskin.errors import DesignError
from eskin.interval import Interval

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import ArrayLike


class Dual:
    """A value and its partial derivatives by name.

    Attributes:
        value: Encloses the value.
        partials: Enclose the derivatives; a name that is missing has derivative 0.
    """

    __slots__ = ("partials", "value")

    def __init__(self, value: Interval, partials: Mapping[str, Interval]) -> None:
        self.value = value
        self.partials = dict(partials)

    def __repr__(self) -> str:
        return f"Dual({self.value!r}, {self.partials!r})"

    def __neg__(self) -> Dual:
        return self._chain(-self.value, Interval(-1.0))

    def __add__(self, other: Dual | Interval | ArrayLike) -> Dual:
        that = _dual(other)
        return self._joined(that, self.value + that.value, Interval(1.0), Interval(1.0))

    __radd__ = __add__

    def __sub__(self, other: Dual | Interval | ArrayLike) -> Dual:
        that = _dual(other)
        return self._joined(that, self.value - that.value, Interval(1.0), Interval(-1.0))

    def __rsub__(self, other: Interval | ArrayLike) -> Dual:
        return -self + other

    def __mul__(self, other: Dual | Interval | ArrayLike) -> Dual:
        that = _dual(other)
        return self._joined(that, self.value * that.value, that.value, self.value)

    __rmul__ = __mul__

    def __truediv__(self, other: Dual | Interval | ArrayLike) -> Dual:
        that = _dual(other)
        inverse = that.value.recip()
        quotient = self.value * inverse
        return self._joined(that, quotient, inverse, -quotient * inverse)

    def __rtruediv__(self, other: Interval | ArrayLike) -> Dual:
        return _dual(other) / self

    def __pow__(self, exponent: SupportsIndex) -> Dual:
        try:
            power = operator.index(exponent)
        except TypeError as error:
            raise DesignError(
                f"power {exponent!r}: only whole numbers can be differentiated here"
            ) from error
        slope = self.value.pown(power - 1) * float(power)
        return self._chain(self.value.pown(power), slope)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Dual:
        if method != "__call__" or options or ufunc not in _FUNCTIONS:
            raise DesignError(f"{getattr(ufunc, '__name__', ufunc)} cannot be differentiated here")
        return _FUNCTIONS[ufunc](*inputs)

    def _chain(self, value: Interval, slope: Interval) -> Dual:
        return Dual(value, {name: slope * partial for name, partial in self.partials.items()})

    def _joined(self, that: Dual, value: Interval, mine: Interval, theirs: Interval) -> Dual:
        partials = {name: mine * partial for name, partial in self.partials.items()}
        for name, partial in that.partials.items():
            term = theirs * partial
            partials[name] = partials[name] + term if name in partials else term
        return Dual(value, partials)


def _dual(value: Dual | Interval | ArrayLike) -> Dual:
    if isinstance(value, Dual):
        return value
    return Dual(value if isinstance(value, Interval) else Interval(value), {})


def _sqrt(x: Dual) -> Dual:
    root = x.value.sqrt()
    return x._chain(root, (root * 2.0).recip())  # noqa: SLF001 - the class's own functions


def _exp(x: Dual) -> Dual:
    grown = x.value.exp()
    return x._chain(grown, grown)  # noqa: SLF001


def _log(x: Dual) -> Dual:
    return x._chain(x.value.log(), x.value.recip())  # noqa: SLF001


def _sin(x: Dual) -> Dual:
    return x._chain(x.value.sin(), x.value.cos())  # noqa: SLF001


def _cos(x: Dual) -> Dual:
    return x._chain(x.value.cos(), -x.value.sin())  # noqa: SLF001


_FUNCTIONS: Final[dict[Any, Callable[..., Dual]]] = {
    np.sqrt: _sqrt,
    np.exp: _exp,
    np.log: _log,
    np.sin: _sin,
    np.cos: _cos,
    np.negative: lambda x: -x,
    np.square: lambda x: x * x,
    np.add: lambda a, b: _dual(a) + b,
    np.subtract: lambda a, b: _dual(a) - b,
    np.multiply: lambda a, b: _dual(a) * b,
    np.divide: lambda a, b: _dual(a) / b,
}
