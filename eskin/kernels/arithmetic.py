"""Interval arithmetic on bounds, IEEE 1788-2015 clause 10.5; empty is ``[inf, -inf]``.

All bounds are the tightest, but for those of `multiply_add` where a step on the way overflows and
the result does not.

Loops take flat arrays; an operand with step 0 is one interval for all elements. They go block by
block, in which every operand is contiguous, so that the compiler makes vector instructions of them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin.kernels.double_double import product_of, sum_of
from eskin.kernels.intrinsics import fma
from eskin.kernels.jit import inlined, kernel, part
from eskin.kernels.outward_rounding import (
    EXACT_PRODUCT,
    FACTOR,
    add_down,
    add_up,
    div_down,
    div_up,
    greater,
    mul_up,
    next_up,
    sqrt_down,
    sqrt_up,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

Floats: TypeAlias = "NDArray[np.float64]"
Pair: TypeAlias = "tuple[float, float]"


BLOCK: Final = 1024
"""Elements in a block: four operands and two results of them fit a level-1 cache."""
_FAR: Final = 2.0**-200
"""A sum beyond it is no other for a product below `EXACT_PRODUCT`."""


@part
def block_of(values: Floats, step: int, start: int, n: int) -> Floats:
    """The block's values: a part of the array, or the one value as often as it takes."""
    if step == 1:
        return values[start : start + n]
    block = np.empty(n)
    block[:] = values[0]
    return block


@inlined
def unless_empty(lo: float, hi: float, empty: bool) -> Pair:  # noqa: FBT001 - compiled code knows no keywords
    """The bounds without negative zeros, or the empty interval."""
    return (math.inf if empty else lo + 0.0), (-math.inf if empty else hi + 0.0)


@inlined
def add_pair(a: float, b: float, c: float, d: float) -> Pair:
    """``[a, b] + [c, d]``."""
    return unless_empty(add_down(a, c), add_up(b, d), (a > b) | (c > d))


@inlined
def product_up(a: float, b: float) -> float:
    """``a·b`` rounded up; zero times infinity is zero: the infinity is a bound, not a member."""
    return 0.0 if (a == 0.0) | (b == 0.0) else mul_up(a, b)


@inlined
def greatest_product(a: float, b: float, c: float, d: float) -> float:
    """The greatest member of ``[a, b] · [c, d]``, rounded up: at an end, with its better factor."""
    return greater(product_up(a, c if a < 0.0 else d), product_up(b, c if b < 0.0 else d))


@inlined
def mul_pair(a: float, b: float, c: float, d: float) -> Pair:
    """``[a, b] · [c, d]``; the least corner is minus the greatest of ``[-b, -a] · [c, d]``."""
    lo, hi = -greatest_product(-b, -a, c, d), greatest_product(a, b, c, d)
    return unless_empty(lo, hi, (a > b) | (c > d))


@inlined
def div_pair(a: float, b: float, c: float, d: float) -> Pair:
    """``[a, b] / [c, d]``: all quotients that exist.

    A divisor that is not positive changes signs with the dividend. Then the bounds lie at the ends
    that the dividend's signs choose; infinity by infinity is not among them.
    """
    turned = d <= 0.0
    w, x = (-b, -a) if turned else (a, b)
    y, z = (-d, -c) if turned else (c, d)
    lo, hi = div_down(w, z if w >= 0.0 else y), div_up(x, y if x >= 0.0 else z)
    lo = -math.inf if (y < 0.0) | ((y == 0.0) & (w < 0.0)) else lo
    hi = math.inf if (y < 0.0) | ((y == 0.0) & (x > 0.0)) else hi
    lo = 0.0 if (w == 0.0) & ((x == 0.0) | (y >= 0.0)) else lo
    hi = 0.0 if (x == 0.0) & ((w == 0.0) | (y >= 0.0)) else hi
    return unless_empty(lo, hi, (a > b) | (c > d) | ((c == 0.0) & (d == 0.0)))


@inlined
def mig_of(a: float, b: float) -> float:
    """Least magnitude in ``[a, b]``."""
    return greater(greater(a, -b), 0.0)


@inlined
def sqr_pair(a: float, b: float) -> Pair:
    """``x²``."""
    least, most = mig_of(a, b), greater(-a, b)
    return unless_empty(-product_up(-least, least), product_up(most, most), a > b)


@inlined
def sqrt_pair(a: float, b: float) -> Pair:
    """``√x`` of what is not negative."""
    lo = sqrt_down(greater(a, 0.0))
    return unless_empty(lo, sqrt_up(greater(b, 0.0)), (a > b) | (b < 0.0))


@inlined
def fma_up(a: float, b: float, c: float) -> float:
    """Least float ``>= a·b + c``; an infinite ``c`` wins, and zero times infinity is zero.

    What z lacks is found without error and rounded once (Boldo and Muller 2011, "Exact and
    approximated error of the FMA"), and ``z - rounded`` is exact: the sign of their sum is right.
    Where the product is small, all is multiplied by ``2**1200`` before, as in `mul_up`; beside a c
    of more than ``2**-200``, where that might overflow, a small product decides by its sign. Where
    the product overflows, all is divided by ``2**1200``: the factors exceed 1, so that is exact for
    them, and for c where it can take the total back among the floats; what a lesser c loses is
    nothing beside the total's error. Where another step overflows, the bound is one float more.
    """
    total, product = fma(a, b, c), a * b
    small = abs(product) < EXACT_PRODUCT
    scale = FACTOR if small else (1.0 / FACTOR if abs(product) == math.inf else 1.0)
    x, y, term, rounded = a * scale, b * scale, c * scale * scale, total * scale * scale
    z = fma(x, y, term)
    high, low = product_of(x, y)
    second, third = sum_of(term, low)
    first, second = sum_of(high, second)
    error = (z - rounded) + (((first - z) + second) + third)
    error = high if small & (abs(c) > _FAR) else error
    bound = total if error <= 0.0 else next_up(total)
    return c if (abs(c) == math.inf) | (a == 0.0) | (b == 0.0) else bound


@inlined
def greatest_fma(a: float, b: float, c: float, d: float, f: float) -> float:
    """The greatest member of ``[a, b]·[c, d] + f``, rounded up; see `greatest_product`."""
    return greater(fma_up(a, c if a < 0.0 else d, f), fma_up(b, c if b < 0.0 else d, f))


@kernel
def add(a: Floats, b: Floats, i: int, c: Floats, d: Floats, j: int, lo: Floats, hi: Floats) -> None:
    """Sums."""
    for start in range(0, lo.size, BLOCK):
        n = min(BLOCK, lo.size - start)
        w, x = block_of(a, i, start, n), block_of(b, i, start, n)
        y, z = block_of(c, j, start, n), block_of(d, j, start, n)
        least, most = lo[start : start + n], hi[start : start + n]
        for k in range(n):
            least[k], most[k] = add_pair(w[k], x[k], y[k], z[k])


@kernel
def sub(a: Floats, b: Floats, i: int, c: Floats, d: Floats, j: int, lo: Floats, hi: Floats) -> None:
    """Differences."""
    for start in range(0, lo.size, BLOCK):
        n = min(BLOCK, lo.size - start)
        w, x = block_of(a, i, start, n), block_of(b, i, start, n)
        y, z = block_of(c, j, start, n), block_of(d, j, start, n)
        least, most = lo[start : start + n], hi[start : start + n]
        for k in range(n):
            least[k], most[k] = add_pair(w[k], x[k], -z[k], -y[k])


@kernel
def mul(a: Floats, b: Floats, i: int, c: Floats, d: Floats, j: int, lo: Floats, hi: Floats) -> None:
    """Products."""
    for start in range(0, lo.size, BLOCK):
        n = min(BLOCK, lo.size - start)
        w, x = block_of(a, i, start, n), block_of(b, i, start, n)
        y, z = block_of(c, j, start, n), block_of(d, j, start, n)
        least, most = lo[start : start + n], hi[start : start + n]
        for k in range(n):
            least[k], most[k] = mul_pair(w[k], x[k], y[k], z[k])


@kernel
def div(a: Floats, b: Floats, i: int, c: Floats, d: Floats, j: int, lo: Floats, hi: Floats) -> None:
    """Quotients."""
    for start in range(0, lo.size, BLOCK):
        n = min(BLOCK, lo.size - start)
        w, x = block_of(a, i, start, n), block_of(b, i, start, n)
        y, z = block_of(c, j, start, n), block_of(d, j, start, n)
        least, most = lo[start : start + n], hi[start : start + n]
        for k in range(n):
            least[k], most[k] = div_pair(w[k], x[k], y[k], z[k])


@kernel
def sqr(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Squares."""
    for k in range(lo.size):
        lo[k], hi[k] = sqr_pair(a[k], b[k])


@kernel
def sqrt(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Square roots."""
    for k in range(lo.size):
        lo[k], hi[k] = sqrt_pair(a[k], b[k])


@kernel
def multiply_add(
    a: Floats, b: Floats, c: Floats, d: Floats, e: Floats, f: Floats, lo: Floats, hi: Floats
) -> None:
    """``x·y + z``."""
    for k in range(lo.size):
        most = greatest_fma(a[k], b[k], c[k], d[k], f[k])
        least = -greatest_fma(-b[k], -a[k], c[k], d[k], -e[k])
        empty = (a[k] > b[k]) | (c[k] > d[k]) | (e[k] > f[k])
        lo[k], hi[k] = unless_empty(least, most, empty)
