"""The exponential: reduction by a ln 2 of two words, a polynomial of our own, a proven bound.

``exp(x) = 2**k · exp(r)`` with ``k = rint(x/ln 2)`` and ``|r| <= 0.3466``. The high word of ln 2
has 42 bits and ``k`` at most 11, so ``x - k·HIGH`` is exact; what the low word rounds is kept.

Error, with ``u = 2**-53``, relative to the true value: with ``p = r + r²·Q``, the last sum
``1 + p`` gives ``u`` at most (half of it where the result is below 1); rounding ``p`` gives 0.25 u,
the polynomial's steps 0.0682 · 3u, the reduction 0.01 u, truncation after ``r**13/13!`` 0.05 u.
Divided by the result (at least 0.707, or 1 in the upper half) this stays below 1.55 u. So the
result is within `RELATIVE_ERROR` = 1.6 u; the scaling is exact but where the result is subnormal,
which costs half of the least float besides. Overflow gives ``inf``, NaN gives NaN.
"""

from __future__ import annotations

from typing import Final

from eskin.kernels.compiled import part
from eskin.kernels.instructions import fma, from_bits, to_bits

RELATIVE_ERROR: Final = 0.8 * 2.0**-52
"""Proven relative error of `exp` where the result is a normal float."""
ABSOLUTE_ERROR: Final = 5e-324
"""Proven absolute error besides, from gradual underflow."""
_WIDENING: Final = 1.31 * 2.0**-52  # the error, and u more because the sum is rounded
_LARGEST: Final = 1.7976931348623157e308

_INVERSE_LN2: Final = 1.4426950408889634
_LN2_HIGH: Final = 0.6931471805598903
_LN2_LOW: Final = 5.497923018708371e-14
_LEAST: Final = -760.0  # below, the result is 0; and 2**k stays in reach of two factors
_MOST: Final = 720.0  # above, it is inf
_INTEGER: Final = 6755399441055744.0  # 1.5·2**52: adding it leaves the nearest integer in the bits
_INTEGER_BITS: Final = 0x4338000000000000
_ONE_BITS: Final = 0x3FF0000000000000


@part
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


@part
def exp(x: float) -> float:
    """``e**x``."""
    near = min(max(x, _LEAST), _MOST)
    shifted = fma(near, _INVERSE_LN2, _INTEGER)
    k = shifted - _INTEGER
    high = fma(-k, _LN2_HIGH, near)
    r = fma(-k, _LN2_LOW, high)
    rest = fma(-k, _LN2_LOW, high - r)
    value = 1.0 + (r + fma(r * r, exp_tail(r), rest))
    exponent = to_bits(shifted) - _INTEGER_BITS
    half = exponent >> 1
    first = from_bits(_ONE_BITS + (half << 52))
    second = from_bits(_ONE_BITS + ((exponent - half) << 52))
    scaled = value * first * second
    return scaled if x == x else x  # noqa: PLR0124 - NaN test


@part
def exp_up(x: float) -> float:
    """Upper bound of ``e**x``."""
    value = exp(x)
    return 1.0 if x == 0.0 else fma(value, _WIDENING, value) + ABSOLUTE_ERROR


@part
def exp_down(x: float) -> float:
    """Lower bound of ``e**x``, never negative."""
    value = exp(x)
    bound = max(fma(-_WIDENING, min(value, _LARGEST), min(value, _LARGEST)) - ABSOLUTE_ERROR, 0.0)
    return x + 1.0 if (x == 0.0) | (x > _LARGEST) else bound
