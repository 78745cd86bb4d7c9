"""Angles in two words: arc tangents of quotients, reduced by three exact tangents.

``t = y/x`` between 0 and 1 is turned back by ``atan c``, c being 0, 53/128 or 1: what is left is
``f = (y - c·x)/(x + c·y)``, ``|f| <= 0.201``, ``s = f² <= 0.0404``.
``atan(f) = f·(1 - s/3 + s²·T)``: only T is rounded to floats, with a relative error of 1.2 u, and
``s²·T`` is at most 3.3e-4; that and truncation after ``f**27/27`` stay below ``2**-64``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.kernels import double_double
from eskin.kernels.intrinsics import fma
from eskin.kernels.jit import inlined

if TYPE_CHECKING:
    from eskin.kernels.double_double import Two

PI: Final = (3.141592653589793, 1.2246467991473532e-16)
HALF_PI: Final = (1.5707963267948966, 6.123233995736766e-17)
_QUARTER_PI: Final = (0.7853981633974483, 3.061616997868383e-17)
_TANGENT: Final = 0.4140625
_ANGLE: Final = (0.3925701350118286, 1.4769733768267405e-17)
_FROM_TANGENT: Final = 0.199
_FROM_ONE: Final = 0.668
_MINUS_THIRD: Final = (-0.3333333333333333, -1.850371707708594e-17)
NOTHING: Final = (0.0, 0.0)


@inlined
def _tail(s: float) -> float:
    """The terms of ``atan(f)/f`` from ``s²`` on, divided by it."""
    tail = fma(s, -0.037037037037037035, 0.04)
    tail = fma(s, tail, -0.043478260869565216)
    tail = fma(s, tail, 0.047619047619047616)
    tail = fma(s, tail, -0.05263157894736842)
    tail = fma(s, tail, 0.058823529411764705)
    tail = fma(s, tail, -0.06666666666666667)
    tail = fma(s, tail, 0.07692307692307693)
    tail = fma(s, tail, -0.09090909090909091)
    tail = fma(s, tail, 0.1111111111111111)
    tail = fma(s, tail, -0.14285714285714285)
    return fma(s, tail, 0.2)


@inlined
def _of_fraction(f: Two) -> Two:
    s = double_double.mul(f, f)
    series = double_double.mul(
        s, double_double.add(_MINUS_THIRD, double_double.scaled(s, _tail(s[0])))
    )
    return double_double.add(f, double_double.mul(f, series))


@inlined
def angle_of(y: Two, x: Two) -> Two:
    """``atan(y/x)`` for ``0 <= y``, ``0 <= x``, not both zero; 90° where x is zero."""
    steep = y[0] > x[0]
    over, under = (x, y) if steep else (y, x)
    t = over[0] / under[0]
    c = 0.0 if t < _FROM_TANGENT else (_TANGENT if t < _FROM_ONE else 1.0)
    turned = NOTHING if t < _FROM_TANGENT else (_ANGLE if t < _FROM_ONE else _QUARTER_PI)
    rest = double_double.sub(over, double_double.scaled(under, c))
    f = double_double.div(rest, double_double.add(under, double_double.scaled(over, c)))
    angle = double_double.add(turned, _of_fraction(f))
    return double_double.sub(HALF_PI, angle) if steep else angle


@inlined
def cosine_of(sine: float) -> Two:
    """``√(1 - x²)`` for ``|x| <= 1``."""
    product = double_double.mul(double_double.sum_of(1.0, -sine), double_double.sum_of(1.0, sine))
    return double_double.sqrt(product)
