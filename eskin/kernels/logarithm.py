"""Natural logarithms in two words: ``ln x = k·ln 2 + 2·atanh(f)``, ``f = (m - 1)/(m + 1)``.

``x = 2**k · m`` with m between ``√½`` and ``√2``, so ``|f| <= 0.1716`` and ``s = f² <= 0.02945``.
``atanh(f) = f·(1 + s/3 + s²·T)``: only T is rounded to floats, with a relative error of 1.2 u, and
``s²·T`` is at most 1.8e-4; that and truncation after ``f**27/27`` stay below ``2**-65``.
Without a multiple of ln 2, ``m - 1`` is exact, or given as exactly as the caller has it: then the
result is right beside 1 as well. With one, the result is at least 0.34, and ``k·ln 2`` is right to
``2**-87``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels import double_double
from eskin.kernels.exponential import power_of_two
from eskin.kernels.intrinsics import fma, to_bits
from eskin.kernels.jit import inlined

if TYPE_CHECKING:
    from eskin.kernels.double_double import Two

_LN2_HIGH: Final = 0.6931471805598903
_LN2_LOW: Final = 5.497923018708371e-14
_INVERSE_LN2: Final = (1.4426950408889634, 2.0355273740931033e-17)
_INVERSE_LN10: Final = (0.4342944819032518, 1.098319650216765e-17)
_THIRD: Final = (0.3333333333333333, 1.850371707708594e-17)
_ROOT_HALF_BITS: Final = 0x3FE6A09E667F3BCD
_NORMAL: Final = 2.0**-1022
_HIDDEN: Final = 2.0**54
"""What makes a subnormal float normal."""
MANY: Final = 2.0**60
"""Beyond it, ``x² + 1`` is ``x²`` to two words."""
ONE: Final = (1.0, 0.0)
TWO: Final = (2.0, 0.0)


@inlined
def _tail(s: float) -> float:
    """The terms of ``atanh(f)/f`` from ``s²`` on, divided by it."""
    tail = fma(s, 0.037037037037037035, 0.04)
    tail = fma(s, tail, 0.043478260869565216)
    tail = fma(s, tail, 0.047619047619047616)
    tail = fma(s, tail, 0.05263157894736842)
    tail = fma(s, tail, 0.058823529411764705)
    tail = fma(s, tail, 0.06666666666666667)
    tail = fma(s, tail, 0.07692307692307693)
    tail = fma(s, tail, 0.09090909090909091)
    tail = fma(s, tail, 0.1111111111111111)
    tail = fma(s, tail, 0.14285714285714285)
    return fma(s, tail, 0.2)


@inlined
def _of_fraction(f: Two, k: float) -> Two:
    """``k·ln 2 + 2·atanh(f)``."""
    s = double_double.mul(f, f)
    series = double_double.mul(s, double_double.add(_THIRD, double_double.scaled(s, _tail(s[0]))))
    half = double_double.add(f, double_double.mul(f, series))
    whole = (2.0 * half[0], 2.0 * half[1])
    turned = double_double.add((k * _LN2_HIGH, 0.0), double_double.product_of(k, _LN2_LOW))
    return whole if k == 0.0 else double_double.add(turned, whole)


@inlined
def _exponent(x: float) -> int:
    """``k`` for a positive float: ``2**-k · x`` lies between ``√½`` and ``√2``."""
    hidden = x < _NORMAL
    bits = to_bits(x * _HIDDEN if hidden else x)
    return ((bits - _ROOT_HALF_BITS) >> 52) - (54 if hidden else 0)


@inlined
def _mantissa(x: Two, k: int) -> Two:
    first, second = power_of_two(-k)
    return x[0] * first * second, x[1] * first * second


@inlined
def log_of_two(x: Two) -> Two:
    """``ln x`` of a positive number of two words."""
    k = _exponent(x[0])
    m = _mantissa(x, k)
    f = double_double.div(double_double.sub(m, ONE), double_double.add(m, ONE))
    return _of_fraction(f, float(k))


@inlined
def log2_of(x: float) -> Two:
    """``log2 x`` of a positive float; powers of two have no second word."""
    k = _exponent(x)
    whole = _mantissa((x, 0.0), k)[0] == 1.0
    return (float(k), 0.0) if whole else double_double.mul(log_of_two((x, 0.0)), _INVERSE_LN2)


@inlined
def log10_of(x: float) -> Two:
    """``log10 x`` of a positive float; powers of ten have no second word.

    A float that is not a power of ten has a logarithm at least ``2**-55`` from the whole numbers
    up to 22; greater powers of ten are no floats.
    """
    high, low = double_double.mul(log_of_two((x, 0.0)), _INVERSE_LN10)
    whole = (high == np.rint(high)) & (high >= 0.0) & (high <= 22.0) & (abs(low) < 2.0**-57)
    return high, (0.0 if whole else low)


@inlined
def log1p_of_two(x: Two, more: float) -> Two:
    """``ln(1 + x) + more·ln 2``, for ``x > -1`` and a whole number ``more``."""
    whole = double_double.add(ONE, x)
    k = _exponent(whole[0])
    m = _mantissa(whole, k)
    over = x if k == 0 else double_double.sub(m, ONE)
    under = double_double.add(x, TWO) if k == 0 else double_double.add(m, ONE)
    return _of_fraction(double_double.div(over, under), float(k) + more)


@inlined
def asinh_of(x: float) -> Two:
    """``asinh x`` for ``x >= 0``: ``ln(1 + x + x²/(1 + √(1 + x²)))``."""
    many = x > MANY
    near = 1.0 if many else x
    square = double_double.product_of(near, near)
    root = double_double.sqrt(double_double.add(ONE, square))
    less = double_double.add((near, 0.0), double_double.div(square, double_double.add(ONE, root)))
    return log1p_of_two(double_double.sum_of(-1.0, x) if many else less, 1.0 if many else 0.0)


@inlined
def acosh_of(x: float) -> Two:
    """``acosh x`` for ``x >= 1``: ``ln(1 + t + √(t·(t + 2)))``, ``t = x - 1``."""
    many = x > MANY
    t = double_double.sum_of(-1.0, x)
    near = ONE if many else t
    less = double_double.add(
        near, double_double.sqrt(double_double.mul(near, double_double.add(near, TWO)))
    )
    return log1p_of_two(t if many else less, 1.0 if many else 0.0)


@inlined
def atanh_of(x: float) -> Two:
    """``atanh x`` for ``0 <= x < 1``: half of ``ln(1 + 2x/(1 - x))``."""
    ratio = double_double.div((2.0 * x, 0.0), double_double.sum_of(1.0, -x))
    high, low = log1p_of_two(ratio, 0.0)
    return 0.5 * high, 0.5 * low
