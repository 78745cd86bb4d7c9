"""Powers and roots of intervals, IEEE 1788-2015 clause 10.5.3: at most one float from the tightest.

Where a result is exact, it stands.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels import two_words
from eskin.kernels.arithmetic import div_pair, mig_of, sqr_pair, sqrt_pair, unless_empty
from eskin.kernels.compiled import kernel, part
from eskin.kernels.exponential import exp_of_two
from eskin.kernels.instructions import fma, from_bits, to_bits
from eskin.kernels.logarithm import log_of_two
from eskin.kernels.rounding import EXACT_PRODUCT, greater, lesser, mul_down, mul_up

if TYPE_CHECKING:
    from eskin.kernels.arithmetic import Floats, Pair
    from eskin.kernels.two_words import Two

MOST_EXACT: Final = 64
"""Beyond it, only powers of powers of two are exact."""


@part
def exponential(exponent: Two) -> tuple[Two, float]:
    """The exponential of an exponent in two words, and its relative error.

    The exponent's relative error is below half of `RELATIVE_ERROR`; what it is in absolute terms
    is the exponential's.
    """
    error = (2.0 + lesser(abs(exponent[0]), 800.0)) * two_words.RELATIVE_ERROR
    return exp_of_two(exponent, 0), error


@part
def power(x: float, y: float) -> tuple[Two, float]:
    """``x^y = exp(y·ln x)`` for ``x > 0``, and its relative error."""
    logarithm = log_of_two((x, 0.0))
    rough = logarithm[0] * y
    return exponential(two_words.scaled(logarithm, y) if abs(rough) < 800.0 else (rough, 0.0))


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
    return max(two_words.below_by(value, error), least)


@part
def power_up(x: float, y: float) -> float:
    """At least ``x^y`` for ``x >= 0``."""
    if power_is_exact(x, y):
        return math.pow(x, y)
    value, error = power(x, y)
    most = math.inf if (x > 1.0) == (y > 0.0) else 1.0
    return min(max(two_words.above_by(value, error), two_words.LEAST), most)


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


@part
def root(x: float, n: int) -> tuple[Two, float]:
    """The n-th root of a positive number, and its relative error: zero where it is exact."""
    value, error = exponential(two_words.div(log_of_two((x, 0.0)), (float(n), 0.0)))
    again = exact_power(value[0], abs(n))
    inverse = (again * x == 1.0) & (fma(again, x, -1.0) == 0.0)
    return value, (0.0 if (again == x if n > 0 else inverse) else error)


@part
def root_down(x: float, n: int) -> float:
    """At most the n-th root of ``x > 0``, or its limit at infinity."""
    if x == math.inf:
        return math.inf if n > 0 else 0.0
    value, error = root(x, n)
    return value[0] if error == 0.0 else two_words.below_by(value, error)


@part
def root_up(x: float, n: int) -> float:
    """At least the n-th root of ``x >= 0``, or its limit."""
    if (x == 0.0) | (x == math.inf):
        return x if n > 0 else 1.0 / x
    value, error = root(x, n)
    return value[0] if error == 0.0 else two_words.above_by(value, error)


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


_SLIGHT: Final = 2.0**-400  # its square is a normal float


@part
def hypotenuse(x: float, y: float) -> tuple[Two, float, bool]:
    """``√(x² + y²)`` but for a power of two as a factor, that factor, and whether it is exact."""
    exponent = (to_bits(greater(x, y)) >> 52) - 1023
    shrink = from_bits((1023 - max(min(exponent, 1020), -1020)) << 52)
    grow = 1.0 / shrink
    near, far = x * shrink, y * shrink
    first, second = two_words.product_of(near, near), two_words.product_of(far, far)
    length = two_words.sqrt(two_words.add(first, second))
    total, rest = two_words.sum_of(first[0], second[0])
    short = (first[1] == 0.0) & (second[1] == 0.0) & (rest == 0.0) & (lesser(near, far) > _SLIGHT)
    return length, grow, short & (fma(length[0], length[0], -total) == 0.0)


@part
def hypot_down(x: float, y: float) -> float:
    """At most ``√(x² + y²)`` for ``x, y >= 0``."""
    if (x == 0.0) | (y == 0.0) | (max(x, y) == math.inf):
        return max(x, y)
    length, grow, exact = hypotenuse(x, y)
    bound = mul_down(two_words.below(length), grow)
    return length[0] * grow if exact else max(bound, max(x, y))


@part
def hypot_up(x: float, y: float) -> float:
    """At least ``√(x² + y²)`` for ``x, y >= 0``."""
    if (x == 0.0) | (y == 0.0) | (max(x, y) == math.inf):
        return max(x, y)
    length, grow, exact = hypotenuse(x, y)
    return length[0] * grow if exact else mul_up(two_words.above(length), grow)


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
