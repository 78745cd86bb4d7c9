"""Parts for coils and capacitors that charge through a resistance, with bounds of their roundings.

With ``x = R t/L`` for a coil and ``P = 1 - e^-x``, all that a charging branch does follows from

    filled(x)   = (P/x)²                        its stored energy, falls with x
    drawn(x)    = (x - P)/x²                    what the source gave, falls with x
    burnt(x)    = (x - P - P²/2)/x³             what a unit of resistance burnt, falls with x

``x·filled(x)`` has one maximum, at `FILLED_PEAK`; ``x·burnt(x)`` has one at `BURNT_PEAK`.
"""

from __future__ import annotations

import math
from typing import Final

from eskin.kernels.jit import part

FILLED_PEAK: Final = 1.2564312086261697
"""Where ``x·filled(x)`` is greatest: ``e^x = 1 + 2x``."""
BURNT_PEAK: Final = 1.8926178329250188
"""Where ``x·burnt(x)`` is greatest: ``3 - filled/burnt = 1``."""
ROUNDINGS: Final = 256
"""Roundings that each function here amounts to at most.

Below 1 the alternating series are summed: 26 terms of Horner's rule, whose sizes add up to 4.5
times the sum, within 240 u; what is left out is below 0.01 u. From 1 on ``P`` (allowed 2 ulp of
the library) cancels to a quarter of it at most in ``drawn`` and in ``burnt``: within 64 u.
"""
_TERMS: Final = 26


@part
def filled(x: float) -> float:
    """``((1 - e^-x)/x)²`` for ``x >= 0``."""
    share = -math.expm1(-x) / x if x > 0.0 else 1.0
    return share * share


@part
def drawn(x: float) -> float:
    """``(x - (1 - e^-x))/x²`` for ``x >= 0``."""
    if x >= 1.0:
        return (x + math.expm1(-x)) / (x * x)
    total = 0.0
    for n in range(_TERMS, 1, -1):
        total = (1.0 - x * total) / n
    return total


@part
def burnt(x: float) -> float:
    """``(x - P - P²/2)/x³`` with ``P = 1 - e^-x``, for ``x >= 0``."""
    if x >= 1.0:
        p = -math.expm1(-x)
        return (x - p - 0.5 * p * p) / (x * x * x)
    # Sum over n >= 3 of (-x)^(n-3)·(2^(n-1) - 2)/n!.
    total, power = 0.0, 2.0 ** (_TERMS - 1)
    for n in range(_TERMS, 2, -1):
        total = (power - 2.0) - x * total / (n + 1.0)
        power *= 0.5
    return total / 6.0


@part
def most_burnt(r_inf: float, r_sup: float, other: float, rate: float) -> float:
    """Greatest ``r·burnt((r + other)·rate)`` for r in ``[r_inf, r_sup]``.

    It rises as long as ``r·(3 - filled/burnt) < r + other``, then falls. Where the maximum lies
    inside, bisection brackets it, and ``burnt`` falls over what is left.
    """
    first, last = r_inf, r_sup
    if not _rises(first, other, rate):
        last = first
    elif _rises(last, other, rate):
        first = last
    else:
        for _ in range(64):
            middle = 0.5 * (first + last)
            if _rises(middle, other, rate):
                first = middle
            else:
                last = middle
    return last * burnt((first + other) * rate)


@part
def _rises(r: float, other: float, rate: float) -> bool:
    x = (r + other) * rate
    return r * (3.0 - filled(x) / burnt(x)) < r + other
