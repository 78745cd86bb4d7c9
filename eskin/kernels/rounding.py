"""Directed rounding in compiled code: each result is the nearest float on its side of the truth.

Where round-to-nearest was exact, or erred to the wanted side (its error is found by an error-free
transformation), its result stands; else it moves by one float. Sources: Ogita, Rump and Oishi 2005
(TwoSum, TwoProduct by fused multiply-add); IEEE 1788-2015, 12.10.1 (accuracy mode "tightest").

Bounds of intervals come in: ``-inf`` where one rounds down, ``inf`` where one rounds up. NaN comes
out of NaN, of ``inf - inf`` and of ``0 · inf``: callers decide these cases.
"""

from __future__ import annotations

import math
from typing import Final

from eskin.kernels.compiled import inlined, part
from eskin.kernels.instructions import fma, from_bits, to_bits

EXACT_PRODUCT: Final = 2.0**-960
"""Above this magnitude the error of a product is a float itself, so fma finds it exactly."""
NORMAL: Final = 2.0**-1020
"""Above this magnitude a quotient has all of its bits."""


@inlined
def greater(a: float, b: float) -> float:
    """The greater of two numbers, one instruction; the second if one is NaN."""
    return a if a > b else b  # noqa: FURB136 - numba's max asks for NaN first


@inlined
def lesser(a: float, b: float) -> float:
    """The lesser of two numbers, one instruction; the second if one is NaN."""
    return a if a < b else b  # noqa: FURB136 - likewise


@inlined
def next_up(x: float) -> float:
    """The next float towards ``inf``; ``inf`` and NaN stay."""
    bits = to_bits(x + 0.0)  # the sum turns -0.0 into 0.0
    step = from_bits(bits + (1 if bits >= 0 else -1))
    return step if x < math.inf else x


@inlined
def next_down(x: float) -> float:
    """The next float towards ``-inf``; ``-inf`` and NaN stay."""
    return -next_up(-x)


@inlined
def add_up(a: float, b: float) -> float:
    """Least float ``>= a + b``."""
    total = a + b
    b_part = total - a
    error = (a - (total - b_part)) + (b - b_part)
    return total if error <= 0.0 else next_up(total)


@inlined
def add_down(a: float, b: float) -> float:
    """Greatest float ``<= a + b``."""
    return -add_up(-a, -b)


@inlined
def sub_up(a: float, b: float) -> float:
    """Least float ``>= a - b``."""
    return add_up(a, -b)


@inlined
def sub_down(a: float, b: float) -> float:
    """Greatest float ``<= a - b``."""
    return -add_up(-a, b)


@inlined
def mul_up(a: float, b: float) -> float:
    """Least float ``>= a·b``; one float more where the product is below `EXACT_PRODUCT`."""
    product = a * b
    error = fma(a, b, -product)
    known = (abs(product) > EXACT_PRODUCT) | (a == 0.0) | (b == 0.0)
    most = 0.0 if (a < 0.0) != (b < 0.0) else math.inf
    return product if (error <= 0.0) & known else lesser(next_up(product), most)


@inlined
def mul_down(a: float, b: float) -> float:
    """Greatest float ``<= a·b``; one float less where the product is below `EXACT_PRODUCT`."""
    return -mul_up(-a, b)


@inlined
def div_up(a: float, b: float) -> float:
    """Least float ``>= a/b`` for ``b != 0``; one float more where a bit may have been lost."""
    quotient = a / b
    rest = fma(-quotient, b, a)
    below = (rest == 0.0) | ((rest < 0.0) == (b > 0.0))
    known = (abs(a) > EXACT_PRODUCT) & (abs(quotient) > NORMAL) & (rest == rest)  # noqa: PLR0124
    stands = (below & known) | (a == 0.0) | (abs(b) == math.inf)
    most = 0.0 if (a < 0.0) != (b < 0.0) else math.inf
    return quotient if stands else lesser(next_up(quotient), most)


@inlined
def div_down(a: float, b: float) -> float:
    """Greatest float ``<= a/b`` for ``b != 0``; one float less where a bit may have been lost."""
    return -div_up(-a, b)


@inlined
def sqrt_up(x: float) -> float:
    """Least float ``>= √x`` for ``x >= 0``; one float more below `EXACT_PRODUCT`."""
    root = math.sqrt(x)
    stands = ((fma(-root, root, x) <= 0.0) & (x > EXACT_PRODUCT)) | (x == 0.0)
    return root if stands else next_up(root)


@inlined
def sqrt_down(x: float) -> float:
    """Greatest float ``<= √x`` for ``x >= 0``; one float less below `EXACT_PRODUCT`."""
    root = math.sqrt(x)
    stands = ((fma(-root, root, x) >= 0.0) & (x > EXACT_PRODUCT)) | (x == 0.0) | (x == math.inf)
    return root if stands else next_down(root)


@part
def libm_up(value: float) -> float:
    """At least what a libm good to one ulp meant: two floats up, but not beyond its sign."""
    return min(next_up(next_up(value)), 0.0) if value < 0.0 else next_up(next_up(value))


@part
def libm_down(value: float) -> float:
    """At most what a libm good to one ulp meant: two floats down, but not beyond its sign."""
    return -libm_up(-value)
