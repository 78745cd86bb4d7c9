"""Operators and elementary functions, IEEE 1788-2015 clause 10.5: all results that exist."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np

from eskin.errors import IntervalError
from eskin.interval.bounds import Bounds
from eskin.interval.evaluation import of_one, of_three, of_two
from eskin.kernels import arithmetic, elementary, trigonometry

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def defers(other: object) -> bool:
    """Whether another operand knows better how to calculate with intervals, by numpy's protocol."""
    known = isinstance(other, Bounds | np.ndarray | np.generic)
    return not known and getattr(other, "__array_ufunc__", None) is not None


_GREATEST_POWER = 2**31


class Arithmetic(Bounds):
    """Calculates outward: the exact result of any members of the operands lies in the result."""

    __slots__ = ()

    @classmethod
    def of(cls, value: Bounds | ArrayLike) -> Self:
        """The interval itself, or the least one around a plain number or array."""
        return value if isinstance(value, cls) else cls(value)

    def __pos__(self) -> Self:
        return self

    def __neg__(self) -> Self:
        return self._trusted(0.0 - self.sup, 0.0 - self.inf)

    def __add__(self, other: Bounds | ArrayLike) -> Self:
        if defers(other):
            return NotImplemented
        return self._trusted(*of_two(arithmetic.add, self, self.of(other)))

    __radd__ = __add__

    def __sub__(self, other: Bounds | ArrayLike) -> Self:
        if defers(other):
            return NotImplemented
        return self._trusted(*of_two(arithmetic.sub, self, self.of(other)))

    def __rsub__(self, other: Bounds | ArrayLike) -> Self:
        return self.of(other) - self

    def __mul__(self, other: Bounds | ArrayLike) -> Self:
        if defers(other):
            return NotImplemented
        return self._trusted(*of_two(arithmetic.mul, self, self.of(other)))

    __rmul__ = __mul__

    def __truediv__(self, other: Bounds | ArrayLike) -> Self:
        """All quotients that exist: ``[1, 2] / [0, 1]`` is ``[1, inf]``; by ``[0, 0]``, empty."""
        if defers(other):
            return NotImplemented
        return self._trusted(*of_two(arithmetic.div, self, self.of(other)))

    def __rtruediv__(self, other: Bounds | ArrayLike) -> Self:
        return self.of(other) / self

    def __pow__(self, exponent: Bounds | ArrayLike | int) -> Self:
        """`pown` for a single whole number, else `pow`, which takes no negative base."""
        if not isinstance(exponent, Bounds) and np.ndim(exponent) == 0:
            single = float(np.asarray(exponent, dtype=np.float64))
            if single.is_integer() and abs(single) <= _GREATEST_POWER:
                return self.pown(int(single))
        return self.pow(exponent)

    def __rpow__(self, base: Bounds | ArrayLike) -> Self:
        return self.of(base).pow(self)

    def __abs__(self) -> Self:
        lo = np.maximum(np.maximum(self.inf, -self.sup), 0.0)
        hi = np.maximum(-self.inf, self.sup)
        empty = self.inf > self.sup
        return self._trusted(np.where(empty, np.inf, lo), np.where(empty, -np.inf, hi))

    def recip(self) -> Self:
        """``1/x``, of what is not zero."""
        return self.of(1.0) / self

    def sqr(self) -> Self:
        """``x²``: never negative, and tighter than ``x * x``."""
        return self._trusted(*of_one(arithmetic.sqr, self))

    def sqrt(self) -> Self:
        """Square root of what is not negative."""
        return self._trusted(*of_one(arithmetic.sqrt, self))

    def fma(self, factor: Bounds | ArrayLike, term: Bounds | ArrayLike) -> Self:
        """``x·factor + term``, rounded once."""
        operands = (self, self.of(factor), self.of(term))
        return self._trusted(*of_three(arithmetic.multiply_add, *operands))

    def pown(self, exponent: int) -> Self:
        """``x^n`` for a whole number n."""
        if int(exponent) != exponent or abs(exponent) > _GREATEST_POWER:
            raise IntervalError(f"pown: {exponent!r} is no integer within ±2³¹; pow takes others")
        return self._trusted(*of_one(elementary.pown, self, int(exponent)))

    def pow(self, exponent: Bounds | ArrayLike) -> Self:
        """``x^y`` of what is not negative, for real powers."""
        return self._trusted(*of_two(elementary.pow_real, self, self.of(exponent)))

    def exp(self) -> Self:
        """Exponential."""
        return self._trusted(*of_one(elementary.exp, self))

    def log(self) -> Self:
        """Natural logarithm of what is positive."""
        return self._trusted(*of_one(elementary.log, self))

    def sin(self) -> Self:
        """Sine of an angle in rad."""
        return self._trusted(*of_one(trigonometry.sin, self))

    def cos(self) -> Self:
        """Cosine of an angle in rad."""
        return self._trusted(*of_one(trigonometry.cos, self))

    def tan(self) -> Self:
        """Tangent of an angle in rad; everything where a pole lies inside."""
        return self._trusted(*of_one(trigonometry.tan, self))

    def atan(self) -> Self:
        """Arc tangent, in rad."""
        return self._trusted(*of_one(trigonometry.atan, self))

    def atan2(self, x: Bounds | ArrayLike) -> Self:
        """Angle of the points ``(x, y)`` in rad, y being this interval; in ``(-π, π]``."""
        return self._trusted(*of_two(trigonometry.atan2, self, self.of(x)))

    def min(self, other: Bounds | ArrayLike) -> Self:
        """The lesser of two numbers, one of each."""
        that = self.of(other)
        empty = (self.inf > self.sup) | (that.inf > that.sup)
        lo, hi = np.minimum(self.inf, that.inf), np.minimum(self.sup, that.sup)
        return self._trusted(np.where(empty, np.inf, lo), np.where(empty, -np.inf, hi))

    def max(self, other: Bounds | ArrayLike) -> Self:
        """The greater of two numbers, one of each."""
        return -(-self).min(-self.of(other))
