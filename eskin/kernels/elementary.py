"""Exponentials and logarithms of intervals, IEEE 1788-2015 clause 10.5.3.

All are our own polynomials with a proven bound, and end in the tightest float or the next one;
where a result is exact, it stands.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels import double_double
from eskin.kernels.arithmetic import unless_empty
from eskin.kernels.double_double import LEAST, above, below
from eskin.kernels.exponential import (
    exp2_of,
    exp10_of,
    exp_down,
    exp_up,
    expm1_of_two,
    power_of_two,
)
from eskin.kernels.jit import inlined, kernel
from eskin.kernels.logarithm import log1p_of_two, log2_of, log10_of, log_of_two
from eskin.kernels.outward_rounding import greater, lesser

if TYPE_CHECKING:
    from eskin.kernels.arithmetic import Floats, Pair
    from eskin.kernels.double_double import Two

TENS: Final = np.array([float(10**n) for n in range(23)])
"""All powers of ten that are floats."""
_TINY: Final = 2.0**-900  # below it, expm1 and log1p are their argument to all digits


@inlined
def _beside_whole(value: Two, x: float, power: float) -> Pair:
    """Bounds of a power with the exponent ``x``, on the right side of that with ``rint(x)``."""
    whole = np.rint(x)
    lo, hi = greater(below(value), 0.0), greater(above(value), LEAST)
    return greater(lo, power if x >= whole else 0.0), lesser(hi, power if x <= whole else math.inf)


@inlined
def _exp2_pair(x: float) -> Pair:
    within = (x >= -1074.0) & (x < 1023.5)
    first, second = power_of_two(int(np.rint(x)) if within else 0)
    value = exp2_of(x)
    pair = _beside_whole(value, x, first * second)
    return pair if within else (greater(below(value), 0.0), greater(above(value), LEAST))


@inlined
def _exp10_pair(x: float) -> Pair:
    within = (x > -0.5) & (x < 22.5)
    value = exp10_of(x)
    pair = _beside_whole(value, x, TENS[int(np.rint(x)) if within else 0])
    return pair if within else (greater(below(value), 0.0), greater(above(value), LEAST))


@inlined
def _expm1_down(x: float) -> float:
    value = (x, 0.0) if abs(x) < _TINY else expm1_of_two((x, 0.0))
    return greater(greater(below(value), x if x <= double_double.GREATEST else -1.0), -1.0)


@inlined
def _expm1_up(x: float) -> float:
    return above((x, 0.0) if abs(x) < _TINY else expm1_of_two((x, 0.0)))


@inlined
def _log_down(x: float) -> float:
    return below(log_of_two((x, 0.0))) if x > 0.0 else -math.inf


@inlined
def _log_up(x: float) -> float:
    return above(log_of_two((x, 0.0))) if x < math.inf else math.inf


@inlined
def _log2_down(x: float) -> float:
    value = log2_of(x)
    bound = value[0] if value[1] == 0.0 else below(value)
    return bound if x > 0.0 else -math.inf


@inlined
def _log2_up(x: float) -> float:
    value = log2_of(x)
    bound = value[0] if value[1] == 0.0 else above(value)
    return bound if x < math.inf else math.inf


@inlined
def _log10_down(x: float) -> float:
    value = log10_of(x)
    bound = value[0] if value[1] == 0.0 else below(value)
    return bound if x > 0.0 else -math.inf


@inlined
def _log10_up(x: float) -> float:
    value = log10_of(x)
    bound = value[0] if value[1] == 0.0 else above(value)
    return bound if x < math.inf else math.inf


@inlined
def _log1p_down(x: float) -> float:
    value = (x, 0.0) if abs(x) < _TINY else log1p_of_two((x, 0.0), 0.0)
    return below(value) if x > -1.0 else -math.inf


@inlined
def _log1p_up(x: float) -> float:
    value = (x, 0.0) if abs(x) < _TINY else log1p_of_two((x, 0.0), 0.0)
    return lesser(above(value), x) if x < math.inf else math.inf


@kernel
def exp(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Exponentials."""
    for k in range(lo.size):
        empty = a[k] > b[k]
        lo[k], hi[k] = unless_empty(exp_down(a[k]), exp_up(b[k]), empty)


@kernel
def exp2(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Powers of two."""
    for k in range(lo.size):
        empty = a[k] > b[k]
        lo[k], hi[k] = unless_empty(_exp2_pair(a[k])[0], _exp2_pair(b[k])[1], empty)


@kernel
def exp10(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Powers of ten."""
    for k in range(lo.size):
        empty = a[k] > b[k]
        lo[k], hi[k] = unless_empty(_exp10_pair(a[k])[0], _exp10_pair(b[k])[1], empty)


@kernel
def expm1(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Exponentials less one."""
    for k in range(lo.size):
        empty = a[k] > b[k]
        lo[k], hi[k] = unless_empty(_expm1_down(a[k]), _expm1_up(b[k]), empty)


@kernel
def log(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Natural logarithms."""
    for k in range(lo.size):
        empty = (a[k] > b[k]) | (b[k] <= 0.0)
        lo[k], hi[k] = unless_empty(_log_down(a[k]), _log_up(b[k]), empty)


@kernel
def log2(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Binary logarithms."""
    for k in range(lo.size):
        empty = (a[k] > b[k]) | (b[k] <= 0.0)
        lo[k], hi[k] = unless_empty(_log2_down(a[k]), _log2_up(b[k]), empty)


@kernel
def log10(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Decimal logarithms."""
    for k in range(lo.size):
        empty = (a[k] > b[k]) | (b[k] <= 0.0)
        lo[k], hi[k] = unless_empty(_log10_down(a[k]), _log10_up(b[k]), empty)


@kernel
def log1p(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Natural logarithms of one more."""
    for k in range(lo.size):
        empty = (a[k] > b[k]) | (b[k] <= -1.0)
        lo[k], hi[k] = unless_empty(_log1p_down(a[k]), _log1p_up(b[k]), empty)
