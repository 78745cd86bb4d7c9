"""Sine and cosine in two words: of angles in rad up to 2⁴⁸, and in half turns of any size.

In rad, ``x - k·π/2`` takes π/2 in four words (214 bits): each product is kept exactly, the first
difference is exact (Sterbenz), and what is left is summed with its errors. No float comes nearer to
a multiple of π/2 than ``2**-61`` (Muller, "Elementary Functions", 3rd ed., table 11.1), so the rest
is right within ``2**-100`` of itself, and never zero but for ``x = 0``: its sign states on which
side of the quarter turn the angle lies. In half turns nothing is rounded but the product with π.

On the rest, ``|z| <= 0.83`` rad (``k`` may be off by rounding where the angle is great), Taylor
polynomials stand in. Rounded to floats, with a relative error of 1.2 u, are only the terms from
``z**9`` on for the sine, at most 6e-7 of it, and from ``z**8`` on for the cosine, at most 8.3e-6
of it; with truncation after ``z**21`` and ``z**20`` that stays below ``2**-65``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels import double_double
from eskin.kernels.arctangent import PI
from eskin.kernels.intrinsics import fma
from eskin.kernels.jit import inlined
from eskin.kernels.logarithm import ONE

if TYPE_CHECKING:
    from typing import TypeAlias

    from eskin.kernels.double_double import Two

    Turned: TypeAlias = tuple[float, Two]

LARGEST: Final = 2.0**48
"""Greatest angle in rad that is reduced."""
_INTEGER: Final = 6755399441055744.0  # 1.5·2**52: adding it leaves the nearest integer
_QUARTERS_OF_ONE: Final = 0.6366197723675814
_QUARTER: Final = (
    1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33, 5.562271104316826e-50,
)  # fmt: skip
_S3: Final = (-0.16666666666666666, -9.25185853854297e-18)
_S5: Final = (0.008333333333333333, 1.1564823173178714e-19)
_S7: Final = (-0.0001984126984126984, -1.7209558293420705e-22)
_C2: Final = (-0.5, 0.0)
_C4: Final = (0.041666666666666664, 2.3129646346357427e-18)
_C6: Final = (-0.001388888888888889, 5.300543954373577e-20)


@inlined
def _sine_tail(t: float) -> float:
    """The terms of ``sin(z)/z`` from ``t⁴`` on, divided by it, for ``t = z²``."""
    tail = fma(t, 1.9572941063391263e-20, -8.22063524662433e-18)
    tail = fma(t, tail, 2.8114572543455206e-15)
    tail = fma(t, tail, -7.647163731819816e-13)
    tail = fma(t, tail, 1.6059043836821613e-10)
    tail = fma(t, tail, -2.505210838544172e-08)
    return fma(t, tail, 2.7557319223985893e-06)


@inlined
def _cosine_tail(t: float) -> float:
    """The terms of ``cos(z)`` from ``t⁴`` on, divided by it."""
    tail = fma(t, 4.110317623312165e-19, -1.5619206968586225e-16)
    tail = fma(t, tail, 4.779477332387385e-14)
    tail = fma(t, tail, -1.1470745597729725e-11)
    tail = fma(t, tail, 2.08767569878681e-09)
    tail = fma(t, tail, -2.755731922398589e-07)
    return fma(t, tail, 2.48015873015873e-05)


@inlined
def _series(t: Two, tail: float, first: Two, second: Two, third: Two) -> Two:
    """``first + t·(second + t·(third + t·tail))``."""
    series = double_double.leading(third, double_double.scaled(t, tail))
    series = double_double.leading(second, double_double.mul(t, series))
    return double_double.leading(first, double_double.mul(t, series))


@inlined
def sine_excess(t: Two) -> Two:
    """``(sin z - z)/z³`` for ``t = z² <= 1``, within ``2**-65`` of itself."""
    return _series(t, _sine_tail(t[0]), _S3, _S5, _S7)


@inlined
def sine_of_rest(z: Two, t: Two) -> Two:
    """``sin z`` for ``|z| <= 0.83``, ``t = z²``."""
    return double_double.leading(z, double_double.mul(z, double_double.mul(t, sine_excess(t))))


@inlined
def cosine_of_rest(t: Two) -> Two:
    """``cos z`` for ``t = z² <= 0.69``."""
    series = _series(t, _cosine_tail(t[0]), _C2, _C4, _C6)
    return double_double.leading(ONE, double_double.mul(t, series))


@inlined
def sine_of(turned: Turned) -> Two:
    """Sine of so many quarter turns and a rest: one series, with the terms that it takes."""
    quarters, z = turned
    t = double_double.mul(z, z)
    place = quarters - 4.0 * floor_of_quarters(quarters)
    odd = (place == 1.0) | (place == 3.0)
    tail = _cosine_tail(t[0]) if odd else _sine_tail(t[0])
    first, second, third = _either(odd, _C2, _S3), _either(odd, _C4, _S5), _either(odd, _C6, _S7)
    lead = _either(odd, ONE, z)
    series = double_double.mul(t, _series(t, tail, first, second, third))
    value = double_double.leading(lead, double_double.mul(lead, series))
    return double_double.signed(value, -1.0 if place >= 2.0 else 1.0)


@inlined
def _either(yes: bool, x: Two, y: Two) -> Two:  # noqa: FBT001 - compiled code knows no keywords
    return (x[0] if yes else y[0]), (x[1] if yes else y[1])


@inlined
def reduced(x: float) -> Turned:
    """Quarter turns and the rest in rad, for ``|x| <= LARGEST``."""
    k = fma(x, _QUARTERS_OF_ONE, _INTEGER) - _INTEGER
    first, first_low = double_double.product_of(k, _QUARTER[0])
    second, second_low = double_double.product_of(k, _QUARTER[1])
    third, third_low = double_double.product_of(k, _QUARTER[2])
    high, a = double_double.sum_of(x - first, -first_low)
    high, b = double_double.sum_of(high, -second)
    middle, a = double_double.sum_of(a, b)
    low, b = double_double.sum_of(-second_low, -third)
    middle, c = double_double.sum_of(middle, low)
    high, middle = double_double.sum_of(high, middle)
    least = (a + b + c) - fma(k, _QUARTER[3], third_low)
    return k, double_double.ordered(high, middle + least)


@inlined
def reduced_of_half_turns(high: float, low: float) -> Turned:
    """Quarter turns, within ±5, and the rest in rad, of ``high + low`` half turns."""
    a = fma(-2.0, np.rint(0.5 * high), high)
    b = fma(-2.0, np.rint(0.5 * low), low)
    total, rest = double_double.sum_of(a, b)
    quarters = np.rint(2.0 * total)
    near = double_double.sum_of(fma(-0.5, quarters, total), rest)
    return quarters, double_double.mul(near, PI)


@inlined
def sine_and_cosine(turned: Turned) -> tuple[Two, Two]:
    """Sine and cosine of so many quarter turns and a rest."""
    quarters, z = turned
    t = double_double.mul(z, z)
    sine, cosine = sine_of_rest(z, t), cosine_of_rest(t)
    place = quarters - 4.0 * floor_of_quarters(quarters)
    odd = (place == 1.0) | (place == 3.0)
    turned_sine, turned_cosine = _either(odd, cosine, sine), _either(odd, sine, cosine)
    return (
        double_double.signed(turned_sine, -1.0 if place >= 2.0 else 1.0),
        double_double.signed(turned_cosine, -1.0 if (place == 1.0) | (place == 2.0) else 1.0),
    )


@inlined
def floor_of_quarters(count: float) -> float:
    """The greatest whole number not above ``count/4``, for a whole ``count``."""
    return (fma(0.25, count, -0.375) + _INTEGER) - _INTEGER
