"""Hyperbolic functions of intervals and their inverses, IEEE 1788-2015 clause 10.5.3.

All of two words, so bounds are the tightest ones or the next floats. Of very small numbers only
``f(x) ~ x`` is used; that ``sinh``, ``atanh`` lie beyond their argument and ``tanh``, ``asinh``
before it decides the rounding there.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels import double_double
from eskin.kernels.arithmetic import mig_of, unless_empty
from eskin.kernels.double_double import above, below, signed
from eskin.kernels.exponential import exp_of_two, expm1_of_two
from eskin.kernels.jit import inlined, kernel
from eskin.kernels.logarithm import ONE, TWO, acosh_of, asinh_of, atanh_of
from eskin.kernels.outward_rounding import greater, lesser

if TYPE_CHECKING:
    from eskin.kernels.arithmetic import Floats
    from eskin.kernels.double_double import Two

TINY: Final = 2.0**-900
"""Below it, these functions are their argument to all digits, and products lose theirs."""
_STEEP: Final = 1.0
_FLAT: Final = 50.0  # tanh(50) is 1 - 7e-44


@inlined
def _halves(x: float) -> tuple[Two, Two]:
    """``exp(x)/2`` and ``exp(-x)/2`` for ``x >= 0``."""
    grown = exp_of_two((x, 0.0), -1)
    shrunk = double_double.div((0.25, 0.0), grown)
    return grown, (shrunk if grown[0] < double_double.GREATEST else (0.0, 0.0))


@inlined
def _sinh_of(x: float) -> Two:
    """``sinh x`` for ``x >= 0``; where it is small, ``(m + m/(m + 1))/2`` with ``m = expm1(x)``."""
    grown, shrunk = _halves(x)
    m = expm1_of_two((lesser(x, _STEEP), 0.0))
    high, low = double_double.add(m, double_double.div(m, double_double.add(m, ONE)))
    steep = double_double.sub(grown, shrunk)
    steep = steep if grown[0] < double_double.GREATEST else grown
    return steep if x > _STEEP else (0.5 * high, 0.5 * low)


@inlined
def _cosh_of(x: float) -> Two:
    """``cosh x`` for ``x >= 0``."""
    grown, shrunk = _halves(x)
    both = double_double.add(grown, shrunk)
    return both if grown[0] < double_double.GREATEST else grown


@inlined
def _tanh_of(x: float) -> Two:
    """``tanh x`` for ``x >= 0``."""
    m = expm1_of_two((2.0 * lesser(x, _FLAT), 0.0))
    return double_double.div(m, double_double.add(m, TWO))


@inlined
def _sinh_up(x: float) -> float:
    size = abs(x)
    value = (size, 0.0) if size < TINY else _sinh_of(size)
    bound = above(signed(value, x))
    below_zero = -double_double.GREATEST if value[0] == math.inf else lesser(bound, x)
    return below_zero if x <= 0.0 else bound


@inlined
def _tanh_up(x: float) -> float:
    size = abs(x)
    bound = above(signed((size, 0.0) if size < TINY else _tanh_of(size), x))
    return lesser(lesser(bound, x), 1.0) if x >= 0.0 else bound


@inlined
def _asinh_up(x: float) -> float:
    size = abs(x)
    bound = above(signed((size, 0.0) if size < TINY else asinh_of(size), x))
    return x if size == math.inf else (lesser(bound, x) if x >= 0.0 else bound)


@inlined
def _atanh_up(x: float) -> float:
    """At least ``atanh x``; infinite from 1 on, and less than anything up to -1."""
    size = lesser(abs(x), 1.0)
    bound = above(signed((size, 0.0) if size < TINY else atanh_of(size), x))
    bound = lesser(bound, x) if x <= 0.0 else bound
    return math.inf if x >= 1.0 else (-math.inf if x <= -1.0 else bound)


@inlined
def _acosh_down(x: float) -> float:
    return greater(below(acosh_of(greater(x, 1.0))), 0.0)


@inlined
def _acosh_up(x: float) -> float:
    return x if x == math.inf else above(acosh_of(greater(x, 1.0)))


@kernel
def sinh(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Hyperbolic sines."""
    for k in range(lo.size):
        lo[k], hi[k] = unless_empty(-_sinh_up(-a[k]), _sinh_up(b[k]), a[k] > b[k])


@kernel
def cosh(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Hyperbolic cosines."""
    for k in range(lo.size):
        least, most = mig_of(a[k], b[k]), greater(-a[k], b[k])
        low = greater(below(_cosh_of(least)), 1.0)
        high = 1.0 if most == 0.0 else above(_cosh_of(most))
        lo[k], hi[k] = unless_empty(low, high, a[k] > b[k])


@kernel
def tanh(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Hyperbolic tangents."""
    for k in range(lo.size):
        lo[k], hi[k] = unless_empty(-_tanh_up(-a[k]), _tanh_up(b[k]), a[k] > b[k])


@kernel
def asinh(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Inverse hyperbolic sines."""
    for k in range(lo.size):
        lo[k], hi[k] = unless_empty(-_asinh_up(-a[k]), _asinh_up(b[k]), a[k] > b[k])


@kernel
def acosh(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Inverse hyperbolic cosines of what is at least 1."""
    for k in range(lo.size):
        empty = (a[k] > b[k]) | (b[k] < 1.0)
        lo[k], hi[k] = unless_empty(_acosh_down(a[k]), _acosh_up(b[k]), empty)


@kernel
def atanh(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Inverse hyperbolic tangents of what lies between -1 and 1."""
    for k in range(lo.size):
        empty = (a[k] > b[k]) | (b[k] <= -1.0) | (a[k] >= 1.0)
        lo[k], hi[k] = unless_empty(-_atanh_up(-a[k]), _atanh_up(b[k]), empty)
