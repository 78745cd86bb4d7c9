"""Lengths, IEEE 1788-2015 clause 10.6.1: nothing overflows or vanishes on the way."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels import double_double
from eskin.kernels.arithmetic import mig_of, unless_empty
from eskin.kernels.intrinsics import fma, from_bits, to_bits
from eskin.kernels.jit import kernel, part
from eskin.kernels.outward_rounding import greater, lesser, mul_down, mul_up

if TYPE_CHECKING:
    from eskin.kernels.arithmetic import Floats
    from eskin.kernels.double_double import Two

_SLIGHT: Final = 2.0**-400  # its square is a normal float


@part
def hypotenuse(x: float, y: float) -> tuple[Two, float, bool]:
    """``√(x² + y²)`` but for a power of two as a factor, that factor, and whether it is exact."""
    exponent = (to_bits(greater(x, y)) >> 52) - 1023
    shrink = from_bits((1023 - max(min(exponent, 1020), -1020)) << 52)
    grow = 1.0 / shrink
    near, far = x * shrink, y * shrink
    first, second = double_double.product_of(near, near), double_double.product_of(far, far)
    length = double_double.sqrt(double_double.add(first, second))
    total, rest = double_double.sum_of(first[0], second[0])
    short = (first[1] == 0.0) & (second[1] == 0.0) & (rest == 0.0) & (lesser(near, far) > _SLIGHT)
    return length, grow, short & (fma(length[0], length[0], -total) == 0.0)


@part
def hypot_down(x: float, y: float) -> float:
    """At most ``√(x² + y²)`` for ``x, y >= 0``."""
    if (x == 0.0) | (y == 0.0) | (max(x, y) == math.inf):
        return max(x, y)
    length, grow, exact = hypotenuse(x, y)
    bound = mul_down(double_double.below(length), grow)
    return length[0] * grow if exact else max(bound, max(x, y))


@part
def hypot_up(x: float, y: float) -> float:
    """At least ``√(x² + y²)`` for ``x, y >= 0``."""
    if (x == 0.0) | (y == 0.0) | (max(x, y) == math.inf):
        return max(x, y)
    length, grow, exact = hypotenuse(x, y)
    return length[0] * grow if exact else mul_up(double_double.above(length), grow)


@kernel
def hypot(
    a: Floats, b: Floats, i: int, c: Floats, d: Floats, j: int, lo: Floats, hi: Floats
) -> None:
    """Lengths of ``(x, y)``."""
    for k in range(lo.size):
        w, x, y, z = a[k * i], b[k * i], c[k * j], d[k * j]
        low = hypot_down(mig_of(w, x), mig_of(y, z))
        high = hypot_up(greater(-w, x), greater(-y, z))
        lo[k], hi[k] = unless_empty(low, high, (w > x) | (y > z))
