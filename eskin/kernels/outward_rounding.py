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

from eskin.kernels.intrinsics import fma, from_bits, to_bits
from eskin.kernels.jit import inlined

EXACT_PRODUCT: Final = 2.0**-960
"""Above this magnitude the error of a product is a float itself, so fma finds it exactly."""
FACTOR: Final = 2.0**600
"""Scales factors of a product below `EXACT_PRODUCT`: its error does not vanish then."""


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
    """Least float ``>= a·b``.

    Where the product is small, its error may be no float, but ``2**1200`` times the error rounds to
    one of its sign: it is a multiple of ``2**-948``, and both factors are at most ``2**114``, so
    that nothing overflows, if neither is zero. If one is, or is infinite, the product stands.
    """
    product = a * b
    scale = FACTOR if abs(product) < EXACT_PRODUCT else 1.0
    error = fma(a * scale, b * scale, -(product * scale * scale))
    return next_up(product) if error > 0.0 else product


@inlined
def mul_down(a: float, b: float) -> float:
    """Greatest float ``<= a·b``."""
    return -mul_up(-a, b)


@inlined
def div_up(a: float, b: float) -> float:
    """Least float ``>= a/b`` for ``b != 0``.

    The rest ``a - b·(a/b)`` gives the side, if it is not so small that it vanishes. Above
    `EXACT_PRODUCT` it is zero or at least ``2**-107·|a|`` where the quotient is normal; else
    ``|b| > 2**60``, and it is a multiple of ``2**-1066``. Below, it is taken ``2**600`` times: zero
    or at least ``2**-582``, since ``|b| > 2**-54`` where the quotient is subnormal. Of an infinite
    number there is no rest, and the quotient stands.
    """
    quotient = a / b
    scale = FACTOR if abs(a) < EXACT_PRODUCT else 1.0
    rest = fma(-(quotient * scale), b, a * scale)
    return next_up(quotient) if (rest > 0.0 if b > 0.0 else rest < 0.0) else quotient


@inlined
def div_down(a: float, b: float) -> float:
    """Greatest float ``<= a/b`` for ``b != 0``."""
    return -div_up(-a, b)


@inlined
def _square_beside(x: float, root: float) -> float:
    """``x - root²``, or a float of its sign: of ``2**1200`` times both where they are small."""
    scale = FACTOR if x < EXACT_PRODUCT else 1.0
    return fma(-(root * scale), root * scale, x * scale * scale)


@inlined
def sqrt_up(x: float) -> float:
    """Least float ``>= √x`` for ``x >= 0``."""
    root = math.sqrt(x)
    return root if (_square_beside(x, root) <= 0.0) else next_up(root)


@inlined
def sqrt_down(x: float) -> float:
    """Greatest float ``<= √x`` for ``x >= 0``."""
    root = math.sqrt(x)
    return root if (_square_beside(x, root) >= 0.0) | (x == math.inf) else next_down(root)
