"""Elementary functions, IEEE 1788-2015 clause 10.5.3: where they are defined."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Self

import numpy as np

from eskin.errors import IntervalError
from eskin.interval.arithmetic import Arithmetic
from eskin.interval.bounds import Bounds
from eskin.interval.conversion import require_plain
from eskin.interval.decoration import holds_zero, undefined_where
from eskin.interval.evaluation import of_one, of_two
from eskin.kernels import angles, elementary, hyperbolic, powers, trigonometry

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_GREATEST_POWER: Final = 2**31


class Functions(Arithmetic):
    """Powers, exponentials, logarithms, angles and hyperbolic functions."""

    __slots__ = ()

    def __pow__(self, exponent: Bounds | ArrayLike | int) -> Self:
        """`pown` for a single whole number, else `pow`, which takes no negative base."""
        require_plain(exponent, "exponent")
        if not isinstance(exponent, Bounds) and np.ndim(exponent) == 0:
            single = float(np.asarray(exponent, dtype=np.float64))
            if single.is_integer() and abs(single) <= _GREATEST_POWER:
                return self.pown(int(single))
        return self.pow(exponent)

    def __rpow__(self, base: Bounds | ArrayLike) -> Self:
        return self.of(base).pow(self)

    def pown(self, exponent: int) -> Self:
        """``x^n`` for a whole number n."""
        if exponent < 0:
            undefined_where(lambda: holds_zero(self))
        whole = _whole(exponent, "pown")
        return self.sqr() if whole == 2 else self._trusted(*of_one(powers.pown, self, whole))

    def pow(self, exponent: Bounds | ArrayLike) -> Self:
        """``x^y`` of what is not negative, for real powers."""
        power = self.of(exponent)
        undefined_where(lambda: (self.inf < 0.0) | ((self.inf <= 0.0) & (power.inf <= 0.0)))
        return self._trusted(*of_two(powers.pow_real, self, power))

    def rootn(self, degree: int) -> Self:
        """The n-th root for a whole n: of negative numbers, too, where n is odd."""
        if degree == 0:
            raise IntervalError("rootn: there is no root of degree 0")
        if degree % 2 == 0:
            undefined_where(lambda: self.inf < 0.0)
        if degree < 0:
            undefined_where(lambda: holds_zero(self))
        return self._trusted(*of_one(powers.rootn, self, _whole(degree, "rootn")))

    def cbrt(self) -> Self:
        """Cube root."""
        return self.rootn(3)

    def exp(self) -> Self:
        """Exponential."""
        return self._trusted(*of_one(elementary.exp, self))

    def exp2(self) -> Self:
        """``2^x``."""
        return self._trusted(*of_one(elementary.exp2, self))

    def exp10(self) -> Self:
        """``10^x``."""
        return self._trusted(*of_one(elementary.exp10, self))

    def expm1(self) -> Self:
        """``exp(x) - 1``, tight beside zero."""
        return self._trusted(*of_one(elementary.expm1, self))

    def log(self) -> Self:
        """Natural logarithm of what is positive."""
        undefined_where(lambda: self.inf <= 0.0)
        return self._trusted(*of_one(elementary.log, self))

    def log2(self) -> Self:
        """Binary logarithm of what is positive."""
        undefined_where(lambda: self.inf <= 0.0)
        return self._trusted(*of_one(elementary.log2, self))

    def log10(self) -> Self:
        """Decimal logarithm of what is positive."""
        undefined_where(lambda: self.inf <= 0.0)
        return self._trusted(*of_one(elementary.log10, self))

    def log1p(self) -> Self:
        """``ln(1 + x)`` of what is greater than -1, tight beside zero."""
        undefined_where(lambda: self.inf <= -1.0)
        return self._trusted(*of_one(elementary.log1p, self))

    def sin(self) -> Self:
        """Sine of an angle in rad."""
        return self._trusted(*of_one(trigonometry.sin, self))

    def cos(self) -> Self:
        """Cosine of an angle in rad."""
        return self._trusted(*of_one(trigonometry.cos, self))

    def tan(self) -> Self:
        """Tangent of an angle in rad; everything where a pole lies inside."""
        made = self._trusted(*of_one(trigonometry.tan, self))
        undefined_where(lambda: np.isinf(made.inf))
        return made

    def asin(self) -> Self:
        """Arc sine in rad, of what lies between -1 and 1."""
        undefined_where(lambda: (self.inf < -1.0) | (self.sup > 1.0))
        return self._trusted(*of_one(angles.asin, self))

    def acos(self) -> Self:
        """Arc cosine in rad, of what lies between -1 and 1."""
        undefined_where(lambda: (self.inf < -1.0) | (self.sup > 1.0))
        return self._trusted(*of_one(angles.acos, self))

    def atan(self) -> Self:
        """Arc tangent, in rad."""
        return self._trusted(*of_one(angles.atan, self))

    def atan2(self, x: Bounds | ArrayLike) -> Self:
        """Angle of the points ``(x, y)`` in rad, y being this interval; in ``(-π, π]``."""
        across = self.of(x)
        undefined_where(lambda: holds_zero(self) & holds_zero(across))
        return self._trusted(*of_two(angles.atan2, self, across))

    def sinh(self) -> Self:
        """Hyperbolic sine."""
        return self._trusted(*of_one(hyperbolic.sinh, self))

    def cosh(self) -> Self:
        """Hyperbolic cosine."""
        return self._trusted(*of_one(hyperbolic.cosh, self))

    def tanh(self) -> Self:
        """Hyperbolic tangent."""
        return self._trusted(*of_one(hyperbolic.tanh, self))

    def asinh(self) -> Self:
        """Inverse hyperbolic sine."""
        return self._trusted(*of_one(hyperbolic.asinh, self))

    def acosh(self) -> Self:
        """Inverse hyperbolic cosine of what is at least 1."""
        undefined_where(lambda: self.inf < 1.0)
        return self._trusted(*of_one(hyperbolic.acosh, self))

    def atanh(self) -> Self:
        """Inverse hyperbolic tangent of what lies between -1 and 1."""
        undefined_where(lambda: (self.inf <= -1.0) | (self.sup >= 1.0))
        return self._trusted(*of_one(hyperbolic.atanh, self))


def _whole(number: int, name: str) -> int:
    require_plain(number, name)
    if int(number) != number or abs(number) > _GREATEST_POWER:
        raise IntervalError(f"{name}: {number!r} is no integer within ±2³¹; pow takes others")
    return int(number)
