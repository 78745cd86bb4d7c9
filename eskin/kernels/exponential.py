"""The exponential: reduction by a ln 2 of two words, a polynomial of our own, a proven bound.

``exp(x) = 2**k · exp(r)`` with ``k = rint(x/ln 2)`` and ``|r| <= 0.3466``. The high word of ln 2
has 42 bits and ``k`` at most 11, so ``x - k·HIGH`` is exact; what the low word rounds is kept.
``exp(r)``, between 0.707 and 1.415, comes out as ``high + low``, right to an error in absolute
terms. Bounds add it to the lower word and round the sum once: that is the tightest float or the
next one. Scaling by ``2**k`` is exact but where the result is subnormal. Overflow gives ``inf``,
and NaN gives NaN. Let ``u = 2**-53``.

`exp_up` and `exp_down`, with ``exp(r) = 1 + r + r²·(½ + r·(1/6 + r·T))``:

- T, between 0.0389 and 0.0448, is rounded to a float: its constant term errs by 0.021 u, its last
  sum by 0.032 u, the terms before by 0.004 u. With ``r**4 <= 0.0145``: 0.00083 u.
- ``r·T``, at most 0.0156, is rounded: 0.0079 u. With ``|r|³ <= 0.0417``: 0.00033 u.
- Truncation after ``r**16/16!``: below ``1e-6 u``.
- What ``r`` lost to rounding, at most u/4, counts with the factor ``exp(r)``, as it should.
- All else is kept in two words; the second ones, below 2 u, round by a few ``u²``, and what is left
  out is of the size of ``u²`` too.

Together below 0.0012 u; `TAIL_ERROR` is 0.00195 u. So a bound is not the tightest only where a
float lies within 0.0032 u of ``exp(r)``. A subnormal result is scaled back, which is exact, to see
whether it was rounded to the wrong side.

`exp_of_two` works in two words (`eskin.kernels.double_double`): only the terms from ``r**5`` on are
rounded to floats, at most 1.2e-4 of ``expm1(r)``, with a relative error of 1.2 u. That and
truncation after ``r**16/16!`` stay below ``2**-65`` of the result.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels import double_double
from eskin.kernels.intrinsics import fma, from_bits, to_bits
from eskin.kernels.jit import inlined
from eskin.kernels.outward_rounding import greater, lesser

if TYPE_CHECKING:
    from eskin.kernels.double_double import Two

TAIL_ERROR: Final = 2.0**-62
"""Proven absolute error of the sum of two floats that the bounds are made of."""
LEAST: Final = 5e-324
_LARGEST: Final = 1.7976931348623157e308

_INVERSE_LN2: Final = 1.4426950408889634
_LN2_HIGH: Final = 0.6931471805598903
_LN2_LOW: Final = 5.497923018708371e-14
_FIRST: Final = -760.0  # below, the result is 0; and 2**k stays in reach of two factors
_LAST: Final = 720.0  # above, it is inf
_INTEGER: Final = 6755399441055744.0  # 1.5·2**52: adding it leaves the nearest integer in the bits
_INTEGER_BITS: Final = 0x4338000000000000
_ONE_BITS: Final = 0x3FF0000000000000
_LN2: Final = (0.6931471805599453, 2.3190468138462996e-17)
_LN10: Final = (2.302585092994046, -2.1707562233822494e-16)
_SIXTH: Final = (0.16666666666666666, 9.25185853854297e-18)
_QUARTER_OF_SIXTH: Final = (0.041666666666666664, 2.3129646346357427e-18)


@inlined
def exp_tail(r: float) -> float:
    """``(exp(r) - 1 - r)/r²`` for ``|r| <= 0.3466``, in floats alone.

    Its product with ``r²``, at most 0.068, rounds by ``0.068 · 3.3u``; truncation after
    ``r**13/13!`` is 0.04 u.
    """
    tail = fma(r, 1.6059043836821613e-10, 2.08767569878681e-09)
    tail = fma(r, tail, 2.505210838544172e-08)
    tail = fma(r, tail, 2.755731922398589e-07)
    tail = fma(r, tail, 2.7557319223985893e-06)
    tail = fma(r, tail, 2.48015873015873e-05)
    tail = fma(r, tail, 0.0001984126984126984)
    tail = fma(r, tail, 0.001388888888888889)
    tail = fma(r, tail, 0.008333333333333333)
    tail = fma(r, tail, 0.041666666666666664)
    tail = fma(r, tail, 0.16666666666666666)
    return fma(r, tail, 0.5)


@inlined
def _long_tail(r: float) -> float:
    """The terms of ``exp(r)`` from ``r**5`` on, divided by ``r**5``."""
    tail = fma(r, 4.779477332387385e-14, 7.647163731819816e-13)
    tail = fma(r, tail, 1.1470745597729725e-11)
    tail = fma(r, tail, 1.6059043836821613e-10)
    tail = fma(r, tail, 2.08767569878681e-09)
    tail = fma(r, tail, 2.505210838544172e-08)
    tail = fma(r, tail, 2.755731922398589e-07)
    tail = fma(r, tail, 2.7557319223985893e-06)
    tail = fma(r, tail, 2.48015873015873e-05)
    tail = fma(r, tail, 0.0001984126984126984)
    tail = fma(r, tail, 0.001388888888888889)
    return fma(r, tail, 0.008333333333333333)


@inlined
def _of_rest(r: float, rest: float) -> Two:
    """``exp(r + rest)`` for ``|r| <= 0.3466`` and a rest of at most half of its last place."""
    sixth, sixth_low = double_double.ordered(
        _SIXTH[0], r * fma(r, _long_tail(r), _QUARTER_OF_SIXTH[0])
    )
    half, half_low = double_double.product_of(r, sixth)
    half, more = double_double.ordered(0.5, half)
    half_low = more + fma(r, sixth_low + _SIXTH[1], half_low)
    square, square_low = double_double.product_of(r, r)
    q, q_low = double_double.product_of(square, half)
    q_low = fma(square_low, half, fma(square, half_low, q_low))
    p, p_low = double_double.ordered(r, q)
    high, low = double_double.ordered(1.0, p)
    return high, low + (p_low + (q_low + fma(rest, p, rest)))


@inlined
def _reduced(x: float) -> tuple[float, float, int]:
    """``r``, what it lost to rounding, and k: ``x = k·ln 2 + r``."""
    near = lesser(greater(x, _FIRST), _LAST)
    shifted = fma(near, _INVERSE_LN2, _INTEGER)
    k = shifted - _INTEGER
    above = fma(-k, _LN2_HIGH, near)
    r = fma(-k, _LN2_LOW, above)
    return r, fma(-k, _LN2_LOW, above - r), to_bits(shifted) - _INTEGER_BITS


@inlined
def exp_up(x: float) -> float:
    """Upper bound of ``e**x``, nearly always the tightest; at most 1 where x is not positive."""
    r, rest, k = _reduced(x)
    high, low = _of_rest(r, rest)
    first, second = power_of_two(k)
    near, error = double_double.ordered(high, low + TAIL_ERROR)
    near = (from_bits(to_bits(near) + 1) if error > 0.0 else near) * first
    scaled = near * second
    bound = scaled + (LEAST if scaled * _inverse(second) < near else 0.0)
    bound = lesser(bound, 1.0) if x <= 0.0 else bound
    return bound if x == x else x  # noqa: PLR0124 - NaN test


@inlined
def exp_down(x: float) -> float:
    """Lower bound of ``e**x``, nearly always the tightest; at least 1 where x is not negative."""
    r, rest, k = _reduced(x)
    high, low = _of_rest(r, rest)
    first, second = power_of_two(k)
    near, error = double_double.ordered(high, low - TAIL_ERROR)
    near = (from_bits(to_bits(near) - 1) if error < 0.0 else near) * first
    scaled = near * second
    bound = lesser(scaled - (LEAST if scaled * _inverse(second) > near else 0.0), _LARGEST)
    bound = greater(bound, 1.0 if x >= 0.0 else 0.0)
    return bound if x <= _LARGEST else x


@inlined
def expm1_excess(r: Two) -> Two:
    """``(exp(r) - 1 - r)/r²`` for ``|r| <= 0.3467``, within ``2**-62``."""
    sum_ = double_double.add(_QUARTER_OF_SIXTH, double_double.scaled(r, _long_tail(r[0])))
    sum_ = double_double.add(_SIXTH, double_double.mul(r, sum_))
    return double_double.add((0.5, 0.0), double_double.mul(r, sum_))


@inlined
def expm1_of_rest(r: Two) -> Two:
    """``exp(r) - 1`` for ``|r| <= 0.3467``."""
    sum_ = double_double.add((1.0, 0.0), double_double.mul(r, expm1_excess(r)))
    return double_double.mul(r, sum_)


@inlined
def power_of_two(exponent: int) -> Two:
    """``2**exponent`` as two factors, each within reach, for an exponent within ±2000."""
    half = exponent >> 1
    first = from_bits(_ONE_BITS + (half << 52))
    return first, from_bits(_ONE_BITS + ((exponent - half) << 52))


@inlined
def _inverse(power: float) -> float:
    """The inverse of a power of two."""
    return from_bits(2 * _ONE_BITS - to_bits(power))


@inlined
def multiple_of_ln2(x: Two) -> tuple[int, Two]:
    """``k`` and ``r`` with ``x = k·ln 2 + r``, ``|r| <= 0.3467``; for ``|x| <= 760``."""
    shifted = fma(x[0], _INVERSE_LN2, _INTEGER)
    k = shifted - _INTEGER
    high, low = double_double.product_of(k, _LN2_LOW)
    r = double_double.sub((fma(-k, _LN2_HIGH, x[0]), x[1]), (high, low))
    return to_bits(shifted) - _INTEGER_BITS, r


@inlined
def within_reach(x: Two) -> Two:
    """The number, or where its exponential is nothing or infinite, the next that can be reduced."""
    near = lesser(greater(x[0], _FIRST), _LAST)
    return near, (x[1] if near == x[0] else 0.0)


@inlined
def exp_of_two(x: Two, exponent: int) -> Two:
    """``2**exponent · exp(x)`` of a number of two words."""
    k, r = multiple_of_ln2(within_reach(x))
    high, low = double_double.add((1.0, 0.0), expm1_of_rest(r))
    first, second = power_of_two(k + exponent)
    return high * first * second, low * first * second


@inlined
def expm1_of_two(x: Two) -> Two:
    """``exp(x) - 1`` of a number of two words."""
    k, r = multiple_of_ln2(within_reach(x))
    rest = expm1_of_rest(r)
    high, low = double_double.add((1.0, 0.0), rest)
    first, second = power_of_two(k)
    grown = (high * first * second, low * first * second)
    less = grown if grown[0] == math.inf else double_double.add(grown, (-1.0, 0.0))
    return rest if k == 0 else less


@inlined
def exp2_of(x: float) -> Two:
    """``2**x``; whole powers are exact as long as they are floats."""
    near = lesser(greater(x, -1100.0), 1030.0)
    shifted = near + _INTEGER
    k = to_bits(shifted) - _INTEGER_BITS
    rest = expm1_of_rest(double_double.scaled(_LN2, near - (shifted - _INTEGER)))
    high, low = double_double.add((1.0, 0.0), rest)
    first, second = power_of_two(k)
    return high * first * second, low * first * second


@inlined
def exp10_of(x: float) -> Two:
    """``10**x``."""
    near = lesser(greater(x, -330.0), 310.0)
    return exp_of_two(double_double.scaled(_LN10, near), 0)
