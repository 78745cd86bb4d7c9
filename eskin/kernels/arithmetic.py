"""Interval arithmetic on bounds, IEEE 1788-2015 clause 10.5; empty is ``[inf, -inf]``.

Tightest, but for one float on each side in `multiply_add`, in products, squares and quotients below
`eskin.kernels.rounding.EXACT_PRODUCT`, and in roots of what is below it.

Loops take flat arrays; an operand with step 0 is one interval for all elements. They go block by
block, in which every operand is contiguous, so that the compiler makes vector instructions of them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin.kernels.compiled import inlined, kernel, part
from eskin.kernels.instructions import fma
from eskin.kernels.rounding import (
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
    """The greatest corner of ``[a, b] · [c, d]``, rounded up."""
    return greater(
        greater(product_up(a, c), product_up(b, d)), greater(product_up(a, d), product_up(b, c))
    )


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
def fma_corner(a: float, b: float, c: float) -> float:
    """``a·b + c`` rounded once; an infinite ``c`` wins, and zero times infinity is zero."""
    return c if (abs(c) == math.inf) | (a == 0.0) | (b == 0.0) else fma(a, b, c)


@inlined
def greatest_fma(a: float, b: float, c: float, d: float, f: float) -> float:
    """The greatest corner of ``[a, b]·[c, d] + f``, rounded once."""
    return greater(
        greater(fma_corner(a, c, f), fma_corner(b, d, f)),
        greater(fma_corner(a, d, f), fma_corner(b, c, f)),
    )


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
    """``x·y + z``, each bound at most one float from the tightest."""
    for k in range(lo.size):
        most = next_up(greatest_fma(a[k], b[k], c[k], d[k], f[k]))
        least = -next_up(greatest_fma(-b[k], -a[k], c[k], d[k], -e[k]))
        empty = (a[k] > b[k]) | (c[k] > d[k]) | (e[k] > f[k])
        lo[k], hi[k] = unless_empty(least, most, empty)
