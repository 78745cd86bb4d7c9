"""Exponentials, logarithms and powers of intervals, IEEE 1788-2015 clauses 10.5.3 and 10.5.4.

A scalar libm is good to less than one ulp where it is any good (glibc, musl and Apple's claim 0.51
to 0.98 ulp for these functions), but nobody certifies it: its results are moved by two floats. The
exponential is our own, with a proven bound. Where a result is exact, it stands.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels.arithmetic import div_pair, mig_of, sqr_pair, unless_empty
from eskin.kernels.compiled import kernel, part
from eskin.kernels.exponential import exp_down, exp_up
from eskin.kernels.instructions import fma
from eskin.kernels.rounding import EXACT_PRODUCT, libm_down, libm_up

if TYPE_CHECKING:
    from eskin.kernels.arithmetic import Floats, Pair

GREATEST: Final = 1.7976931348623157e308
MOST_EXACT: Final = 64
"""Beyond it, only powers of powers of two are exact."""


@part
def log_pair(a: float, b: float) -> Pair:
    """``ln x`` of what is positive."""
    lo, hi = -math.inf, math.inf
    if a > 0.0:
        lo = 0.0 if a == 1.0 else libm_down(math.log(a))
    if b < math.inf:
        hi = 0.0 if b == 1.0 else libm_up(math.log(b))
    return lo, hi


@part
def power(x: float, y: float) -> float:
    """``x^y`` for ``x >= 0``, as C has it."""
    return math.pow(x, y)


@part
def power_is_exact(x: float, y: float) -> bool:
    """Whether ``x^y`` needs no widening."""
    return (
        (x == 0.0) | (x == 1.0) | (y == 0.0) | (y == 1.0) | (x == math.inf) | (abs(y) == math.inf)
    )


@part
def power_down(x: float, y: float) -> float:
    """At most ``x^y`` for ``x >= 0``."""
    value = power(x, y)
    if power_is_exact(x, y):
        return value
    # Powers do not cross 1 where base and exponent do not cross 1 and 0.
    least = 1.0 if (x > 1.0) == (y > 0.0) else 0.0
    return max(libm_down(min(value, GREATEST)), least)


@part
def power_up(x: float, y: float) -> float:
    """At least ``x^y`` for ``x >= 0``."""
    value = power(x, y)
    most = math.inf if (x > 1.0) == (y > 0.0) else 1.0
    return value if power_is_exact(x, y) else min(libm_up(value), most)


@part
def exact_power(x: float, n: int) -> float:
    """``x^n`` if every product on the way is exact, else NaN."""
    value = 1.0
    if n > MOST_EXACT or n < 0 or abs(x) == math.inf:
        return math.nan
    for _ in range(n):
        product = value * x
        if fma(value, x, -product) != 0.0 or abs(product) < EXACT_PRODUCT:
            return math.nan
        value = product
    return value


@part
def whole_power_down(x: float, n: int) -> float:
    """At most ``x^n`` for ``x >= 0``."""
    value = exact_power(x, n)
    return power_down(x, float(n)) if value != value else value  # noqa: PLR0124 - NaN test


@part
def whole_power_up(x: float, n: int) -> float:
    """At least ``x^n`` for ``x >= 0``."""
    value = exact_power(x, n)
    return power_up(x, float(n)) if value != value else value  # noqa: PLR0124 - NaN test


@part
def even_power(a: float, b: float, n: int) -> Pair:
    """``x^n`` for an even ``n``."""
    least, most = mig_of(a, b), max(-a, b)
    if n < 0:
        least, most = most, least
    return whole_power_down(least, n), whole_power_up(most, n)


@part
def odd_power(a: float, b: float, n: int) -> Pair:
    """``x^n`` for an odd ``n``; zero is not inside of ``[a, b]`` where ``n < 0``."""
    if n < 0:
        a, b = b, a
    lo = whole_power_down(a, n) if a >= 0.0 else -whole_power_up(-a, n)
    hi = whole_power_up(b, n) if b >= 0.0 else -whole_power_down(-b, n)
    return lo, hi


@part
def pown_pair(a: float, b: float, n: int) -> Pair:  # noqa: PLR0911 - one for each case of the standard
    """``x^n`` for a whole number ``n``."""
    if n == 0:
        return 1.0, 1.0
    if n == 2:
        return sqr_pair(a, b)
    if n == -1:
        return div_pair(1.0, 1.0, a, b)
    if n < 0 and a == 0.0 and b == 0.0:
        return math.inf, -math.inf
    if n % 2 == 0:
        return even_power(a, b, n)
    if n > 0 or a > 0.0 or b < 0.0:
        return odd_power(a, b, n)
    if a == 0.0:
        return odd_power(b, b, n)[0], math.inf
    if b == 0.0:
        return -math.inf, odd_power(a, a, n)[1]
    return -math.inf, math.inf


@part
def pow_pair(a: float, b: float, c: float, d: float) -> Pair:
    """``x^y`` for ``x >= 0``: extremes lie in the corners."""
    a = max(a, 0.0) + 0.0  # a power of -0.0 may be -inf
    if b < 0.0 or (b == 0.0 and d <= 0.0):
        return math.inf, -math.inf
    if b == 0.0:
        return 0.0, 0.0
    lo = min(min(power_down(a, c), power_down(a, d)), min(power_down(b, c), power_down(b, d)))
    hi = max(max(power_up(a, c), power_up(a, d)), max(power_up(b, c), power_up(b, d)))
    return lo, hi


@kernel
def exp(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Exponentials."""
    for k in range(lo.size):
        lo[k], hi[k] = unless_empty(exp_down(a[k]), exp_up(b[k]), a[k] > b[k])


@kernel
def log(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Natural logarithms."""
    for k in range(lo.size):
        inside = a[k] <= b[k] and b[k] > 0.0
        lo[k], hi[k] = log_pair(a[k], b[k]) if inside else (math.inf, -math.inf)


@kernel
def pown(a: Floats, b: Floats, n: int, lo: Floats, hi: Floats) -> None:
    """Whole powers."""
    for k in range(lo.size):
        low, high = pown_pair(a[k], b[k], n) if a[k] <= b[k] else (math.inf, -math.inf)
        lo[k], hi[k] = low + 0.0, high + 0.0


@kernel
def pow_real(
    a: Floats, b: Floats, i: int, c: Floats, d: Floats, j: int, lo: Floats, hi: Floats
) -> None:
    """Real powers."""
    for k in range(lo.size):
        some = a[k * i] <= b[k * i] and c[k * j] <= d[k * j]
        pair = pow_pair(a[k * i], b[k * i], c[k * j], d[k * j]) if some else (math.inf, -math.inf)
        lo[k], hi[k] = pair
