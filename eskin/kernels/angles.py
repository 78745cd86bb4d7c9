"""Angles of intervals, IEEE 1788-2015 clause 10.5.3: arc functions, at most one float too wide."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels import double_double
from eskin.kernels.arctangent import HALF_PI, PI, angle_of, cosine_of
from eskin.kernels.arithmetic import unless_empty
from eskin.kernels.double_double import GREATEST, above, below, signed
from eskin.kernels.exponential import power_of_two
from eskin.kernels.intrinsics import to_bits
from eskin.kernels.jit import inlined, kernel, part
from eskin.kernels.logarithm import ONE
from eskin.kernels.outward_rounding import div_down, div_up, greater, lesser, next_down

if TYPE_CHECKING:
    from eskin.kernels.arithmetic import Floats, Pair
    from eskin.kernels.double_double import Two

_TINY: Final = 2.0**-900  # below it, an angle is its tangent to all digits
_SLIM: Final = 2.0**-300  # likewise, of a quotient


@inlined
def _atan_up(x: float) -> float:
    """At least ``atan x``, which is not beyond x."""
    size = lesser(abs(x), GREATEST)
    bound = above(signed((size, 0.0) if size < _TINY else angle_of((size, 0.0), ONE), x))
    return lesser(bound, x) if x >= 0.0 else bound


@inlined
def _asin_up(x: float) -> float:
    """At least ``asin x``, which is not short of x; beyond 1, that of 1."""
    size = lesser(abs(x), 1.0)
    angle = angle_of((size, 0.0), cosine_of(size))
    bound = above(signed((size, 0.0) if size < _TINY else angle, x))
    return lesser(bound, x) if x <= 0.0 else bound


@inlined
def _acos_of(x: float) -> Two:
    angle = angle_of(cosine_of(x), (abs(x), 0.0))
    return double_double.sub(PI, angle) if x < 0.0 else angle


@part
def _angle(y: float, x: float) -> Two:
    """``atan2(y, x)`` for ``y > 0`` and numbers of like size, or where only the axis matters."""
    size = abs(x)
    if y == math.inf or size <= _SLIM * y:
        return HALF_PI
    if size == math.inf or y <= _SLIM * size:
        return PI
    exponent = (to_bits(greater(size, y)) >> 52) - 1023
    first, second = power_of_two(-exponent)
    angle = angle_of((y * first * second, 0.0), (size * first * second, 0.0))
    return double_double.sub(PI, angle) if x < 0.0 else angle


@part
def angle_down(y: float, x: float) -> float:
    """At most ``atan2(y, x)`` for ``y >= 0``."""
    if y == 0.0 or x == math.inf:
        return below(PI) if x < 0.0 else 0.0
    if x > 0.0 and y <= _SLIM * x:
        return max(next_down(div_down(y, x)), 0.0)
    return below(_angle(y, x))


@part
def angle_up(y: float, x: float) -> float:
    """At least ``atan2(y, x)`` for ``y >= 0``."""
    if y == 0.0 or x == math.inf:
        return above(PI) if x < 0.0 else 0.0
    if x > 0.0 and y <= _SLIM * x:
        return div_up(y, x)
    return above(_angle(y, x))


@part
def upper_angles(c: float, d: float, a: float, b: float) -> Pair:
    """``atan2(y, x)`` for y in ``[c, d]``, ``0 <= c``, and x in ``[a, b]``: it falls as x grows."""
    if d == 0.0:
        lo = 0.0 if b > 0.0 else below(PI)
        return lo, (above(PI) if a < 0.0 else 0.0)
    lo = angle_down(c if b > 0.0 else d, b)
    hi = angle_up(d if a >= 0.0 else c, a)
    return lo, hi


@part
def atan2_pair(c: float, d: float, a: float, b: float) -> Pair:
    """``atan2(y, x)`` for y in ``[c, d]``, x in ``[a, b]``; ``[-π, π]`` across the branch cut."""
    if c == 0.0 and d == 0.0 and a == 0.0 and b == 0.0:
        return math.inf, -math.inf
    if c >= 0.0:
        return upper_angles(c, d, a, b)
    if a < 0.0 and d >= 0.0:
        return -above(PI), above(PI)
    if d <= 0.0:
        lo, hi = upper_angles(-d, -c, a, b)
        return -hi, -lo
    return -angle_up(-c, a), angle_up(d, a)


@kernel
def atan(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Arc tangents."""
    for k in range(lo.size):
        lo[k], hi[k] = unless_empty(-_atan_up(-a[k]), _atan_up(b[k]), a[k] > b[k])


@kernel
def asin(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Arc sines of what lies between -1 and 1."""
    for k in range(lo.size):
        empty = (a[k] > b[k]) | (b[k] < -1.0) | (a[k] > 1.0)
        lo[k], hi[k] = unless_empty(-_asin_up(-a[k]), _asin_up(b[k]), empty)


@kernel
def acos(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Arc cosines of what lies between -1 and 1; they fall."""
    for k in range(lo.size):
        empty = (a[k] > b[k]) | (b[k] < -1.0) | (a[k] > 1.0)
        low, high = below(_acos_of(lesser(b[k], 1.0))), above(_acos_of(greater(a[k], -1.0)))
        lo[k], hi[k] = unless_empty(low, high, empty)


@kernel
def atan2(
    c: Floats, d: Floats, i: int, a: Floats, b: Floats, j: int, lo: Floats, hi: Floats
) -> None:
    """Angles of points ``(x, y)``; y comes first."""
    for k in range(lo.size):
        # Adding zero makes -0.0 a plain zero: comparisons of signs see no difference then.
        low, high, left, right = c[k * i] + 0.0, d[k * i] + 0.0, a[k * j] + 0.0, b[k * j] + 0.0
        some = low <= high and left <= right
        pair = atan2_pair(low, high, left, right) if some else (math.inf, -math.inf)
        lo[k], hi[k] = pair[0] + 0.0, pair[1] + 0.0
