"""Numbers of two words: a float and what it lacks, ``high + low`` with ``|low| <= ulp(high)/2``.

Sums and products of floats are exact; everything else errs by less than ``2**-100`` of the result
(Joldes, Muller and Popescu 2017, "Tight and rigorous error bounds for basic building blocks of
double-word arithmetic": at most 10 ``2**-106``), where nothing overflows or underflows.

Functions made of them are within `RELATIVE_ERROR` of the truth, or `LEAST` where it is subnormal.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

from eskin.kernels.intrinsics import fma
from eskin.kernels.jit import inlined
from eskin.kernels.outward_rounding import add_up

Two: TypeAlias = "tuple[float, float]"

RELATIVE_ERROR: Final = 2.0**-63
"""Bound for the error of every function in two words; they stay below half of it."""
LEAST: Final = 5e-324
GREATEST: Final = 1.7976931348623157e308


@inlined
def sum_of(a: float, b: float) -> Two:
    """``a + b``, exact (Knuth's TwoSum)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@inlined
def ordered(a: float, b: float) -> Two:
    """``a + b``, exact for ``|a| >= |b|`` (Dekker's Fast2Sum)."""
    total = a + b
    return total, b - (total - a)


@inlined
def product_of(a: float, b: float) -> Two:
    """``a·b``, exact."""
    product = a * b
    return product, fma(a, b, -product)


@inlined
def add(x: Two, y: Two) -> Two:
    """``x + y``, also where they cancel."""
    high, low = sum_of(x[0], y[0])
    second, third = sum_of(x[1], y[1])
    high, low = ordered(high, low + second)
    return ordered(high, low + third)


@inlined
def leading(x: Two, y: Two) -> Two:
    """``x + y`` for ``|x| >= 2|y|``, where nothing cancels; or where ``y`` is zero."""
    high, low = ordered(x[0], y[0])
    return ordered(high, low + (x[1] + y[1]))


@inlined
def sub(x: Two, y: Two) -> Two:
    """``x - y``, also where they cancel."""
    return add(x, (-y[0], -y[1]))


@inlined
def mul(x: Two, y: Two) -> Two:
    """``x·y``."""
    high, low = product_of(x[0], y[0])
    return ordered(high, low + fma(x[0], y[1], x[1] * y[0]))


@inlined
def scaled(x: Two, factor: float) -> Two:
    """``x·factor``."""
    high, low = product_of(x[0], factor)
    return ordered(high, fma(x[1], factor, low))


@inlined
def div(x: Two, y: Two) -> Two:
    """``x/y``, for ``y != 0``."""
    first = x[0] / y[0]
    high, low = product_of(first, y[0])
    rest = ((x[0] - high) - low) + fma(-first, y[1], x[1])
    return ordered(first, rest / y[0])


@inlined
def sqrt(x: Two) -> Two:
    """``√x``, for ``x >= 0``."""
    root = math.sqrt(x[0])
    rest = fma(-root, root, x[0]) + x[1]
    return ordered(root, 0.0 if root == 0.0 else rest / (2.0 * root))


@inlined
def above_by(x: Two, relative: float) -> float:
    """At least what ``x`` was meant to be: zero is exact, and overflow is infinite."""
    bound = add_up(x[0], fma(abs(x[0]), relative, x[1]) + LEAST)
    return x[0] if (x[0] == 0.0) | (x[0] == math.inf) else bound


@inlined
def below_by(x: Two, relative: float) -> float:
    """At most what ``x`` was meant to be: zero is exact, and overflow is the greatest float."""
    bound = -add_up(-x[0], fma(abs(x[0]), relative, -x[1]) + LEAST)
    return x[0] if x[0] == 0.0 else (GREATEST if x[0] == math.inf else bound)


@inlined
def above(x: Two) -> float:
    """At least what ``x`` was meant to be, within `RELATIVE_ERROR`."""
    return above_by(x, RELATIVE_ERROR)


@inlined
def below(x: Two) -> float:
    """At most what ``x`` was meant to be, within `RELATIVE_ERROR`."""
    return below_by(x, RELATIVE_ERROR)


@inlined
def signed(x: Two, sign: float) -> Two:
    """An odd function's value from the one at the argument's magnitude."""
    return (-x[0], -x[1]) if sign < 0.0 else x
