"""Interval arithmetic on bounds, IEEE 1788-2015 clause 10.5: tightest, empty is ``[inf, -inf]``.

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
    next_down,
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


@part
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


@part
def quotient_down(a: float, b: float) -> float:
    """``a/b`` rounded down; infinity by infinity is zero, which the other corners have as well."""
    return 0.0 if (abs(a) == math.inf) & (abs(b) == math.inf) else div_down(a, b)


@part
def quotient_up(a: float, b: float) -> float:
    """``a/b`` rounded up; infinity by infinity is zero."""
    return 0.0 if (abs(a) == math.inf) & (abs(b) == math.inf) else div_up(a, b)


@part
def div_by_positive(a: float, b: float, c: float, d: float) -> Pair:
    """``[a, b] / [c, d]`` for ``0 <= c``, ``0 < d``."""
    if a == 0.0 and b == 0.0:
        return 0.0, 0.0
    if c > 0.0:
        lo = min(quotient_down(a, c), quotient_down(a, d))
        return lo, max(quotient_up(b, c), quotient_up(b, d))
    if a >= 0.0:
        return quotient_down(a, d), math.inf
    if b <= 0.0:
        return -math.inf, quotient_up(b, d)
    return -math.inf, math.inf


@part
def div_pair(a: float, b: float, c: float, d: float) -> Pair:
    """``[a, b] / [c, d]``: all quotients that exist."""
    if (a > b) or (c > d) or (c == 0.0 and d == 0.0):
        return math.inf, -math.inf
    if c < 0.0 < d:
        return (0.0, 0.0) if a == 0.0 and b == 0.0 else (-math.inf, math.inf)
    if c >= 0.0:
        lo, hi = div_by_positive(a, b, c, d)
    else:
        lo, hi = div_by_positive(-b, -a, -d, -c)
    return lo + 0.0, hi + 0.0


@part
def mig_of(a: float, b: float) -> float:
    """Least magnitude in ``[a, b]``."""
    return greater(greater(a, -b), 0.0)


@part
def sqr_pair(a: float, b: float) -> Pair:
    """``x²``."""
    least, most = mig_of(a, b), greater(-a, b)
    return unless_empty(-product_up(-least, least), product_up(most, most), a > b)


@part
def sqrt_pair(a: float, b: float) -> Pair:
    """``√x`` of what is not negative."""
    lo = sqrt_down(max(a, 0.0))
    return unless_empty(lo, sqrt_up(max(b, 0.0)), (a > b) | (b < 0.0))


@part
def fma_corner(a: float, b: float, c: float) -> float:
    """``a·b + c`` rounded once; an infinite ``c`` wins, and zero times infinity is zero."""
    if abs(c) == math.inf or a == 0.0 or b == 0.0:
        return c
    return fma(a, b, c)


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
    """``x·y + z``, one float wider than the tightest."""
    for k in range(lo.size):
        if a[k] > b[k] or c[k] > d[k] or e[k] > f[k]:
            lo[k], hi[k] = math.inf, -math.inf
            continue
        least, most = math.inf, -math.inf
        for x in (a[k], b[k]):
            for y in (c[k], d[k]):
                least = min(least, fma_corner(x, y, e[k]))
                most = max(most, fma_corner(x, y, f[k]))
        lo[k], hi[k] = next_down(least), next_up(most)
