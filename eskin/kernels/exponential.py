"""The exponential: reduction by a ln 2 of two words, a polynomial of our own, a proven bound.

``exp(x) = 2**k · exp(r)`` with ``k = rint(x/ln 2)`` and ``|r| <= 0.3466``. The high word of ln 2
has 42 bits and ``k`` at most 11, so ``x - k·HIGH`` is exact; what the low word rounds is kept.

Error, with ``u = 2**-53``, before the last rounding, in absolute terms (``exp(r)`` lies between
0.707 and 1.415): with ``q = r²·Q``, at most 0.068, the steps of ``q`` round by ``0.068 · 3.3u``;
what ``r`` lost to rounding enters with the factor ``1 + r`` instead of ``exp(r)``, 0.02 u;
truncation after ``r**13/13!``, 0.04 u. ``1 + (r + q)`` is kept as two floats without error.
Together below `TAIL_ERROR` = 0.3 u. The bounds add it to the lower of the two and round their sum
once, so they are the nearest floats or the next ones. `exp` rounds to nearest: 0.5 u more below 1,
``u`` above, which divided by the result stays within `RELATIVE_ERROR` = 1.6 u. The scaling is exact
but where the result is subnormal, which costs half of the least float. Overflow gives ``inf``, NaN
gives NaN.

`exp_of_two` works in two words (`eskin.kernels.two_words`): only the terms from ``r**5`` on are
rounded to floats, at most 1.2e-4 of ``expm1(r)``, with a relative error of 1.2 u. That and
truncation after ``r**16/16!`` stay below ``2**-65`` of the result.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels import two_words
from eskin.kernels.compiled import inlined
from eskin.kernels.instructions import fma, from_bits, to_bits
from eskin.kernels.rounding import add_down, add_up, greater, lesser

if TYPE_CHECKING:
    from eskin.kernels.two_words import Two

RELATIVE_ERROR: Final = 0.8 * 2.0**-52
"""Proven relative error of `exp` where the result is a normal float."""
ABSOLUTE_ERROR: Final = 5e-324
"""Proven absolute error besides, from gradual underflow."""
TAIL_ERROR: Final = 0.15 * 2.0**-52
"""Proven absolute error of the sum of two floats that the bounds are made of."""
_LARGEST: Final = 1.7976931348623157e308

_INVERSE_LN2: Final = 1.4426950408889634
_LN2_HIGH: Final = 0.6931471805598903
_LN2_LOW: Final = 5.497923018708371e-14
_LEAST: Final = -760.0  # below, the result is 0; and 2**k stays in reach of two factors
_MOST: Final = 720.0  # above, it is inf
_INTEGER: Final = 6755399441055744.0  # 1.5·2**52: adding it leaves the nearest integer in the bits
_INTEGER_BITS: Final = 0x4338000000000000
_ONE_BITS: Final = 0x3FF0000000000000
_LN2: Final = (0.6931471805599453, 2.3190468138462996e-17)
_LN10: Final = (2.302585092994046, -2.1707562233822494e-16)
_SIXTH: Final = (0.16666666666666666, 9.25185853854297e-18)
_QUARTER_OF_SIXTH: Final = (0.041666666666666664, 2.3129646346357427e-18)


@inlined
def exp_tail(r: float) -> float:
    """``(exp(r) - 1 - r)/r²`` for ``|r| <= 0.3466``."""
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
def _reduced(x: float) -> tuple[float, float, float, float]:
    """``exp(x)`` as ``(high + low) · first · second``; the factors are powers of two."""
    near = lesser(greater(x, _LEAST), _MOST)
    shifted = fma(near, _INVERSE_LN2, _INTEGER)
    k = shifted - _INTEGER
    above = fma(-k, _LN2_HIGH, near)
    r = fma(-k, _LN2_LOW, above)
    rest = fma(-k, _LN2_LOW, above - r)
    q = fma(r * r, exp_tail(r), fma(r, rest, rest))
    p = r + q
    high = 1.0 + p
    low = (p - (high - 1.0)) + (q - (p - r))
    exponent = to_bits(shifted) - _INTEGER_BITS
    first, second = power_of_two(exponent)
    return high, low, first, second


@inlined
def exp(x: float) -> float:
    """``e**x``."""
    high, _, first, second = _reduced(x)
    scaled = high * first * second
    return scaled if x == x else x  # noqa: PLR0124 - NaN test


@inlined
def exp_up(x: float) -> float:
    """Upper bound of ``e**x``; at most 1 where x is not positive."""
    high, low, first, second = _reduced(x)
    bound = add_up(high, low + TAIL_ERROR) * first * second + ABSOLUTE_ERROR
    bound = lesser(bound, 1.0) if x <= 0.0 else bound
    return bound if x == x else x  # noqa: PLR0124 - NaN test


@inlined
def exp_down(x: float) -> float:
    """Lower bound of ``e**x``, never negative; at least 1 where x is not."""
    high, low, first, second = _reduced(x)
    bound = lesser(add_down(high, low - TAIL_ERROR) * first * second, _LARGEST) - ABSOLUTE_ERROR
    bound = greater(bound, 1.0 if x >= 0.0 else 0.0)
    return bound if x <= _LARGEST else x


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
def expm1_excess(r: Two) -> Two:
    """``(exp(r) - 1 - r)/r²`` for ``|r| <= 0.3467``, within ``2**-62``."""
    sum_ = two_words.add(_QUARTER_OF_SIXTH, two_words.scaled(r, _long_tail(r[0])))
    sum_ = two_words.add(_SIXTH, two_words.mul(r, sum_))
    return two_words.add((0.5, 0.0), two_words.mul(r, sum_))


@inlined
def expm1_of_rest(r: Two) -> Two:
    """``exp(r) - 1`` for ``|r| <= 0.3467``."""
    sum_ = two_words.add((1.0, 0.0), two_words.mul(r, expm1_excess(r)))
    return two_words.mul(r, sum_)


@inlined
def power_of_two(exponent: int) -> Two:
    """``2**exponent`` as two factors, each within reach, for an exponent within ±2000."""
    half = exponent >> 1
    first = from_bits(_ONE_BITS + (half << 52))
    return first, from_bits(_ONE_BITS + ((exponent - half) << 52))


@inlined
def multiple_of_ln2(x: Two) -> tuple[int, Two]:
    """``k`` and ``r`` with ``x = k·ln 2 + r``, ``|r| <= 0.3467``; for ``|x| <= 760``."""
    shifted = fma(x[0], _INVERSE_LN2, _INTEGER)
    k = shifted - _INTEGER
    high, low = two_words.product_of(k, _LN2_LOW)
    r = two_words.sub((fma(-k, _LN2_HIGH, x[0]), x[1]), (high, low))
    return to_bits(shifted) - _INTEGER_BITS, r


@inlined
def within_reach(x: Two) -> Two:
    """The number, or where its exponential is nothing or infinite, the next that can be reduced."""
    near = lesser(greater(x[0], _LEAST), _MOST)
    return near, (x[1] if near == x[0] else 0.0)


@inlined
def exp_of_two(x: Two, exponent: int) -> Two:
    """``2**exponent · exp(x)`` of a number of two words."""
    k, r = multiple_of_ln2(within_reach(x))
    high, low = two_words.add((1.0, 0.0), expm1_of_rest(r))
    first, second = power_of_two(k + exponent)
    return high * first * second, low * first * second


@inlined
def expm1_of_two(x: Two) -> Two:
    """``exp(x) - 1`` of a number of two words."""
    k, r = multiple_of_ln2(within_reach(x))
    rest = expm1_of_rest(r)
    high, low = two_words.add((1.0, 0.0), rest)
    first, second = power_of_two(k)
    grown = (high * first * second, low * first * second)
    less = grown if grown[0] == math.inf else two_words.add(grown, (-1.0, 0.0))
    return rest if k == 0 else less


@inlined
def exp2_of(x: float) -> Two:
    """``2**x``; whole powers are exact as long as they are floats."""
    near = lesser(greater(x, -1100.0), 1030.0)
    shifted = near + _INTEGER
    k = to_bits(shifted) - _INTEGER_BITS
    rest = expm1_of_rest(two_words.scaled(_LN2, near - (shifted - _INTEGER)))
    high, low = two_words.add((1.0, 0.0), rest)
    first, second = power_of_two(k)
    return high * first * second, low * first * second


@inlined
def exp10_of(x: float) -> Two:
    """``10**x``."""
    near = lesser(greater(x, -330.0), 310.0)
    return exp_of_two(two_words.scaled(_LN10, near), 0)
