"""Operators and functions of exact arithmetic, IEEE 1788-2015 clause 10.5: all that exist."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np

from eskin.interval.bounds import Bounds
from eskin.interval.decoration import holds_zero, undefined_where
from eskin.interval.evaluation import of_one, of_three, of_two
from eskin.kernels import arithmetic, hypotenuse

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from eskin.interval.conversion import Floats


def defers(other: object) -> bool:
    """Whether another operand knows better how to calculate with intervals, by numpy's protocol."""
    known = isinstance(other, Bounds | np.ndarray | np.generic)
    return not known and getattr(other, "__array_ufunc__", None) is not None


def _round_away(x: Floats) -> Floats:
    whole = np.trunc(x)
    with np.errstate(invalid="ignore"):
        up = np.abs(x - whole) >= 0.5
    return whole + np.where(up, np.sign(x), 0.0)


def _width(x: Bounds) -> tuple[Floats, Floats]:
    """Half of the width in two words: without error, but for less than the least float."""
    with np.errstate(all="ignore"):
        top, bottom = 0.5 * x.sup, 0.5 * x.inf
        width = top - bottom
        part = width - top
        return width, (top - (width - part)) - (bottom + part)


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
        divisor = self.of(other)
        undefined_where(lambda: holds_zero(divisor))
        return self._trusted(*of_two(arithmetic.div, self, divisor))

    def __rtruediv__(self, other: Bounds | ArrayLike) -> Self:
        return self.of(other) / self

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
        undefined_where(lambda: self.inf < 0.0)
        return self._trusted(*of_one(arithmetic.sqrt, self))

    def fma(self, factor: Bounds | ArrayLike, term: Bounds | ArrayLike) -> Self:
        """``x·factor + term``, rounded once."""
        operands = (self, self.of(factor), self.of(term))
        return self._trusted(*of_three(arithmetic.multiply_add, *operands))

    def hypot(self, other: Bounds | ArrayLike) -> Self:
        """``√(x² + y²)``."""
        return self._trusted(*of_two(hypotenuse.hypot, self, self.of(other)))

    def sign(self) -> Self:
        """-1, 0 or 1."""
        return self._stepped(np.sign)

    def ceil(self) -> Self:
        """The least whole number that is not below."""
        return self._stepped(np.ceil)

    def floor(self) -> Self:
        """The greatest whole number that is not above."""
        return self._stepped(np.floor)

    def trunc(self) -> Self:
        """The next whole number towards zero."""
        return self._stepped(np.trunc)

    def round_ties_to_even(self) -> Self:
        """The nearest whole number; of two, the even one, as `numpy.rint` has it."""
        return self._stepped(np.rint)

    def round_ties_to_away(self) -> Self:
        """The nearest whole number; of two, the one farther from zero."""
        return self._stepped(_round_away)

    def _stepped(self, step: Callable[[Floats], Floats]) -> Self:
        """A function that never falls, and whose results are floats."""
        empty = self.inf > self.sup
        lo, hi = step(self.inf) + 0.0, step(self.sup) + 0.0
        return self._trusted(np.where(empty, np.inf, lo), np.where(empty, -np.inf, hi))

    def lesser(self, other: Bounds | ArrayLike) -> Self:
        """The lesser of two numbers, one of each."""
        that = self.of(other)
        empty = (self.inf > self.sup) | (that.inf > that.sup)
        lo, hi = np.minimum(self.inf, that.inf), np.minimum(self.sup, that.sup)
        return self._trusted(np.where(empty, np.inf, lo + 0.0), np.where(empty, -np.inf, hi + 0.0))

    def greater(self, other: Bounds | ArrayLike) -> Self:
        """The greater of two numbers, one of each."""
        return -(-self).lesser(-self.of(other))

    def cancel_minus(self, other: Bounds | ArrayLike) -> Self:
        """The least z with ``other + z`` around this; everything where there is none."""
        that = self.of(other)
        lo, hi = (
            self._end(self.inf) - self._end(that.inf),
            self._end(self.sup) - self._end(that.sup),
        )
        bounded = np.isfinite(that.inf) & np.isfinite(that.sup)
        empty = (self.inf > self.sup) & (bounded | (that.inf > that.sup))
        bounded &= np.isfinite(self.inf) & np.isfinite(self.sup) & ~self._is_narrower(that)
        low = np.where(bounded, lo.inf, np.where(empty, np.inf, -np.inf))
        return self._trusted(low, np.where(bounded, hi.sup, np.where(empty, -np.inf, np.inf)))

    def cancel_plus(self, other: Bounds | ArrayLike) -> Self:
        """The least z with ``z - other`` around this; everything where there is none."""
        return self.cancel_minus(-self.of(other))

    def _end(self, side: Floats) -> Self:
        """Bounds as numbers, whose differences round outward; infinite ones as anything."""
        finite = np.where(np.isfinite(side), side, 0.0)
        return self._trusted(finite, finite)

    def _is_narrower(self, other: Bounds) -> NDArray[np.bool_]:
        """Whether the width is less than another's, exactly; of bounded intervals."""
        ours, theirs = _width(self), _width(other)
        return np.asarray((ours[0] < theirs[0]) | ((ours[0] == theirs[0]) & (ours[1] < theirs[1])))
