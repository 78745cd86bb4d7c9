"""Powers and roots of intervals, IEEE 1788-2015 clause 10.5.3: at most one float from the tightest.

Where a result is exact, it stands.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels import double_double
from eskin.kernels.arithmetic import div_pair, mig_of, sqrt_pair
from eskin.kernels.exponential import exp_of_two
from eskin.kernels.intrinsics import fma
from eskin.kernels.jit import kernel, part
from eskin.kernels.logarithm import log_of_two
from eskin.kernels.outward_rounding import EXACT_PRODUCT, lesser

if TYPE_CHECKING:
    from eskin.kernels.arithmetic import Floats, Pair
    from eskin.kernels.double_double import Two

MOST_EXACT: Final = 64
"""Beyond it, only powers of powers of two are exact."""
_SMALLEST: Final = 2.0**-900  # between them, products in two words keep all of their digits
_LARGEST: Final = 2.0**1000


@part
def exponential(exponent: Two) -> tuple[Two, float]:
    """The exponential of an exponent in two words, and its relative error.

    The exponent's relative error is below half of `RELATIVE_ERROR`; what it is in absolute terms
    is the exponential's.
    """
    error = (2.0 + lesser(abs(exponent[0]), 800.0)) * double_double.RELATIVE_ERROR
    return exp_of_two(exponent, 0), error


@part
def repeated(x: float, n: int) -> Two:
    """``x^n`` for ``|n| <= 64`` by products: within ``2**-93`` where none leaves the range."""
    value, factor, left = (1.0, 0.0), (x, 0.0), abs(n)
    while left > 0:
        if left % 2 == 1:
            value = double_double.mul(value, factor)
        factor = double_double.mul(factor, factor)
        left //= 2
    return value if n > 0 else double_double.div((1.0, 0.0), value)


@part
def power(x: float, y: float) -> tuple[Two, float]:
    """``x^y`` for ``x > 0``, by products or as ``exp(y·ln x)``, and its relative error."""
    if abs(y) <= MOST_EXACT and y == math.floor(y):
        value = repeated(x, int(y))
        if _SMALLEST < value[0] < _LARGEST:
            return value, double_double.RELATIVE_ERROR
    logarithm = log_of_two((x, 0.0))
    rough = logarithm[0] * y
    return exponential(double_double.scaled(logarithm, y) if abs(rough) < 800.0 else (rough, 0.0))


@part
def power_is_exact(x: float, y: float) -> bool:
    """Whether ``x^y`` needs no widening."""
    return (
        (x == 0.0) | (x == 1.0) | (y == 0.0) | (y == 1.0) | (x == math.inf) | (abs(y) == math.inf)
    )


@part
def power_down(x: float, y: float) -> float:
    """At most ``x^y`` for ``x >= 0``."""
    if power_is_exact(x, y):
        return math.pow(x, y)
    value, error = power(x, y)
    # Powers do not cross 1 where base and exponent do not cross 1 and 0.
    least = 1.0 if (x > 1.0) == (y > 0.0) else 0.0
    return max(double_double.below_by(value, error), least)


@part
def power_up(x: float, y: float) -> float:
    """At least ``x^y`` for ``x >= 0``."""
    if power_is_exact(x, y):
        return math.pow(x, y)
    value, error = power(x, y)
    most = math.inf if (x > 1.0) == (y > 0.0) else 1.0
    return min(max(double_double.above_by(value, error), double_double.LEAST), most)


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
    """``x^n`` for a whole number ``n`` but 2."""
    if n == 0:
        return 1.0, 1.0
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
def least_power(a: float, b: float, c: float, d: float) -> float:
    """The least corner of ``[a, b]^[c, d]``, ``0 <= a``: powers rise with y where x exceeds 1."""
    if a >= 1.0:
        return power_down(a if c >= 0.0 else b, c)
    if b <= 1.0:
        return power_down(a if d >= 0.0 else b, d)
    return min(power_down(a, d), power_down(b, c))


@part
def greatest_power(a: float, b: float, c: float, d: float) -> float:
    """The greatest corner of ``[a, b]^[c, d]``, ``0 <= a``."""
    if a >= 1.0:
        return power_up(b if d >= 0.0 else a, d)
    if b <= 1.0:
        return power_up(b if c >= 0.0 else a, c)
    return max(power_up(a, c), power_up(b, d))


@part
def pow_pair(a: float, b: float, c: float, d: float) -> Pair:
    """``x^y`` for ``x >= 0``: extremes lie in the corners."""
    a = max(a, 0.0) + 0.0  # a power of -0.0 may be -inf
    if b < 0.0 or (b == 0.0 and d <= 0.0):
        return math.inf, -math.inf
    if b == 0.0:
        return 0.0, 0.0
    return least_power(a, b, c, d), greatest_power(a, b, c, d)


@part
def root(x: float, n: int) -> tuple[Two, float]:
    """The n-th root of a positive number, and its relative error: zero where it is exact."""
    value, error = exponential(double_double.div(log_of_two((x, 0.0)), (float(n), 0.0)))
    again = exact_power(value[0], abs(n))
    inverse = (again * x == 1.0) & (fma(again, x, -1.0) == 0.0)
    return value, (0.0 if (again == x if n > 0 else inverse) else error)


@part
def root_down(x: float, n: int) -> float:
    """At most the n-th root of ``x > 0``, or its limit at infinity."""
    if x == math.inf:
        return math.inf if n > 0 else 0.0
    value, error = root(x, n)
    return value[0] if error == 0.0 else double_double.below_by(value, error)


@part
def root_up(x: float, n: int) -> float:
    """At least the n-th root of ``x >= 0``, or its limit."""
    if (x == 0.0) | (x == math.inf):
        return x if n > 0 else 1.0 / x
    value, error = root(x, n)
    return value[0] if error == 0.0 else double_double.above_by(value, error)


@part
def positive_roots(a: float, b: float, n: int) -> Pair:
    """The n-th roots of ``[a, b]``, ``0 <= a``, ``0 < b``."""
    if n < 0:
        return root_down(b, n), root_up(a, n)
    return (root_down(a, n) if a > 0.0 else 0.0), root_up(b, n)


@part
def rootn_pair(a: float, b: float, n: int) -> Pair:  # noqa: PLR0911 - one for each case
    """The n-th root: where n is even, of what is not negative; where n < 0, of what is not zero."""
    if n == 1:
        return a, b
    if n == -1:
        return div_pair(1.0, 1.0, a, b)
    if n == 2:
        return sqrt_pair(a, b)
    a = max(a, 0.0) + 0.0 if n % 2 == 0 else a
    if b < a or (n < 0 and a == 0.0 and b == 0.0):
        return math.inf, -math.inf
    if a >= 0.0:
        return positive_roots(a, b, n) if b > 0.0 else (0.0, 0.0)
    if b <= 0.0:
        lo, hi = positive_roots(-b + 0.0, -a, n)
        return -hi, -lo
    return (-root_up(-a, n), root_up(b, n)) if n > 0 else (-math.inf, math.inf)


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


@kernel
def rootn(a: Floats, b: Floats, n: int, lo: Floats, hi: Floats) -> None:
    """Whole roots."""
    for k in range(lo.size):
        low, high = rootn_pair(a[k] + 0.0, b[k] + 0.0, n) if a[k] <= b[k] else (math.inf, -math.inf)
        lo[k], hi[k] = low + 0.0, high + 0.0
