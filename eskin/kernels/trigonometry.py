"""Sine, cosine and tangent of intervals, IEEE 1788-2015 clause 10.5.3.

Each bound is at most one float from the tightest.

An angle is reduced to whole quarter turns and a rest whose sign is certain
(`kernels.trig_double_double`). So a turning point lies inside exactly where its number lies between
the first quarter turn that is reached and the last.

Beyond 2⁴⁸ rad only a single number is reduced, by `eskin.kernels.large_angles`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels import double_double
from eskin.kernels.arithmetic import unless_empty
from eskin.kernels.jit import inlined, kernel, part
from eskin.kernels.large_angles import reduced_of_any
from eskin.kernels.outward_rounding import greater, lesser
from eskin.kernels.trig_double_double import (
    LARGEST,
    floor_of_quarters,
    reduced,
    sine_and_cosine,
    sine_of,
)

if TYPE_CHECKING:
    from eskin.kernels.arithmetic import Floats, Pair
    from eskin.kernels.trig_double_double import Turned

_QUOTIENT_ERROR: Final = 2.0 * double_double.RELATIVE_ERROR


@inlined
def _reaches(turned_a: Turned, turned_b: Turned, place: float, period: float) -> bool:
    """Whether ``place + n·period`` quarter turns lie between two angles; a period of 2 or 4."""
    first = turned_a[0] + (1.0 if turned_a[1][0] > 0.0 else 0.0) - place
    last = turned_b[0] - (1.0 if turned_b[1][0] < 0.0 else 0.0) - place
    share = 4.0 / period
    return -period * floor_of_quarters(-share * first) <= last


@inlined
def _near(x: float) -> float:
    """The angle where it is reduced here, else zero."""
    return x if abs(x) <= LARGEST else 0.0


@inlined
def _range(from_: Turned, to: Turned) -> Pair:
    """Range of the sine between two angles."""
    first, last = sine_of(from_), sine_of(to)
    rises = (first[0] < last[0]) | ((first[0] == last[0]) & (first[1] <= last[1]))
    lo = double_double.below((first[0] if rises else last[0], first[1] if rises else last[1]))
    hi = double_double.above((last[0] if rises else first[0], last[1] if rises else first[1]))
    bottom, top = _reaches(from_, to, -1.0, 4.0), _reaches(from_, to, 1.0, 4.0)
    return (-1.0 if bottom else greater(lo, -1.0)), (1.0 if top else lesser(hi, 1.0))


@inlined
def _sine_pair(a: float, b: float) -> Pair:
    return _range(reduced(_near(a)), reduced(_near(b)))


@inlined
def _cosine_range(from_: Turned, to: Turned) -> Pair:
    return _range((from_[0] + 1.0, from_[1]), (to[0] + 1.0, to[1]))


@inlined
def _cosine_pair(a: float, b: float) -> Pair:
    lo, hi = _cosine_range(reduced(_near(a)), reduced(_near(b)))
    return (1.0 if (a == 0.0) & (b == 0.0) else lo), hi


@inlined
def _tangent_range(from_: Turned, to: Turned) -> Pair:
    sine, cosine = sine_and_cosine(from_)
    sine_b, cosine_b = sine_and_cosine(to)
    lo = double_double.below_by(double_double.div(sine, cosine), _QUOTIENT_ERROR)
    hi = double_double.above_by(double_double.div(sine_b, cosine_b), _QUOTIENT_ERROR)
    pole = _reaches(from_, to, 1.0, 2.0)
    return (-math.inf if pole else lo), (math.inf if pole else hi)


@part
def _is_far(a: float, b: float) -> bool:
    return (a <= b) & (greater(-a, b) > LARGEST)


@kernel
def sin(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Sines."""
    for k in range(lo.size):
        low, high = _sine_pair(a[k], b[k])
        lo[k], hi[k] = unless_empty(low, high, a[k] > b[k])
    for k in range(lo.size):
        if _is_far(a[k], b[k]):
            lo[k], hi[k] = -1.0, 1.0
            if a[k] == b[k]:
                turned = reduced_of_any(a[k])
                lo[k], hi[k] = _range(turned, turned)


@kernel
def cos(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Cosines."""
    for k in range(lo.size):
        low, high = _cosine_pair(a[k], b[k])
        lo[k], hi[k] = unless_empty(low, high, a[k] > b[k])
    for k in range(lo.size):
        if _is_far(a[k], b[k]):
            lo[k], hi[k] = -1.0, 1.0
            if a[k] == b[k]:
                turned = reduced_of_any(a[k])
                lo[k], hi[k] = _cosine_range(turned, turned)


@kernel
def tan(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Tangents: they grow from pole to pole."""
    for k in range(lo.size):
        low, high = _tangent_range(reduced(_near(a[k])), reduced(_near(b[k])))
        lo[k], hi[k] = unless_empty(low, high, a[k] > b[k])
    for k in range(lo.size):
        if _is_far(a[k], b[k]):
            lo[k], hi[k] = -math.inf, math.inf
            if a[k] == b[k]:
                turned = reduced_of_any(a[k])
                lo[k], hi[k] = _tangent_range(turned, turned)
