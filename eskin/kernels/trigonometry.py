"""Sine, cosine and tangent of intervals, IEEE 1788-2015 clause 10.5.3.

A scalar libm is good to less than one ulp where it is any good (glibc, musl and Apple's claim 0.51
to 0.98 ulp for these functions), but nobody certifies it: its results are moved by two floats.

Each turning point is looked for with a tolerance that is far above the error of the reduction to
one turn, and so small that what it lets in differs from the truth by less than a float.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels.compiled import kernel, part
from eskin.kernels.instructions import fma
from eskin.kernels.rounding import libm_down, libm_up, sub_up

if TYPE_CHECKING:
    from eskin.kernels.arithmetic import Floats, Pair

TURN: Final = 6.283185307179586
"""2π to the nearest float, and what is missing."""
TURN_REST: Final = 2.4492935982947064e-16
HALF_TURN: Final = 3.141592653589793
QUARTER: Final = 1.5707963267948966
LARGEST: Final = 2.0**48
"""Beyond it, only a single number is reduced: by libm, which does so exactly."""
NEAR: Final = 1e-9
"""Nearer to a pole, signs decide."""
TOLERANCE: Final = 1e-10
"""``1 - cos(1e-10) < 1e-20``."""


@part
def within_turn(x: float) -> float:
    """``x`` less whole turns: in ``[-π, π]``, good to 1e-14 for ``|x| <= LARGEST``."""
    turns = math.floor(x / TURN + 0.5)
    return fma(-turns, TURN_REST, fma(-turns, TURN, x))


@part
def reaches(start: float, width: float, point: float) -> bool:
    """Whether ``[start, start + width]`` reaches a point, or all but."""
    return (start - TOLERANCE <= point) & (point <= start + width + TOLERANCE)


@part
def is_wild(a: float, b: float) -> bool:
    """Whether nothing is known but ``[-1, 1]``."""
    return (sub_up(b, a) >= TURN) | ((max(-a, b) > LARGEST) & (a != b))


@part
def libm_down_from_zero(value: float) -> float:
    """At most a value whose zero is exact."""
    return 0.0 if value == 0.0 else libm_down(value)


@part
def libm_up_from_zero(value: float) -> float:
    """At least a value whose zero is exact."""
    return 0.0 if value == 0.0 else libm_up(value)


@part
def sin_pair(a: float, b: float) -> Pair:
    """``sin x``."""
    if is_wild(a, b):
        return -1.0, 1.0
    first, last = math.sin(a), math.sin(b)
    lo, hi = libm_down_from_zero(min(first, last)), libm_up_from_zero(max(first, last))
    if a != b:
        start, width = within_turn(a), sub_up(b, a)
        if reaches(start, width, QUARTER) or reaches(start, width, 5.0 * QUARTER):
            hi = 1.0
        if reaches(start, width, -QUARTER) or reaches(start, width, 3.0 * QUARTER):
            lo = -1.0
    return max(lo, -1.0), min(hi, 1.0)


@part
def cos_pair(a: float, b: float) -> Pair:
    """``cos x``."""
    if is_wild(a, b):
        return -1.0, 1.0
    if a == 0.0 and b == 0.0:
        return 1.0, 1.0
    first, last = math.cos(a), math.cos(b)
    lo, hi = libm_down(min(first, last)), libm_up(max(first, last))
    if a != b:
        start, width = within_turn(a), sub_up(b, a)
        if reaches(start, width, 0.0) or reaches(start, width, TURN):
            hi = 1.0
        if reaches(start, width, HALF_TURN) or reaches(start, width, -HALF_TURN):
            lo = -1.0
        if reaches(start, width, 3.0 * HALF_TURN):
            lo = -1.0
    return max(lo, -1.0), min(hi, 1.0)


@part
def passes_pole(start: float, width: float, first: float, last: float) -> bool:
    """Whether an odd quarter turn lies inside; beside one, the tangent's sign tells the side."""
    pole = -QUARTER
    for _ in range(4):
        from_start, to_end = pole - start, start + width - pole
        left = from_start > NEAR or (from_start > -NEAR and first > 0.0)
        right = to_end > NEAR or (to_end > -NEAR and last < 0.0)
        if left and right:
            return True
        pole += HALF_TURN
    return False


@part
def tan_pair(a: float, b: float) -> Pair:
    """``tan x``: grows from pole to pole."""
    first, last = math.tan(a), math.tan(b)
    if a != b:
        width = sub_up(b, a)
        if width > HALF_TURN or max(-a, b) > LARGEST:
            return -math.inf, math.inf
        if passes_pole(within_turn(a), width, first, last):
            return -math.inf, math.inf
    return libm_down_from_zero(first), libm_up_from_zero(last)


@kernel
def sin(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Sines."""
    for k in range(lo.size):
        lo[k], hi[k] = sin_pair(a[k], b[k]) if a[k] <= b[k] else (math.inf, -math.inf)


@kernel
def cos(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Cosines."""
    for k in range(lo.size):
        lo[k], hi[k] = cos_pair(a[k], b[k]) if a[k] <= b[k] else (math.inf, -math.inf)


@kernel
def tan(a: Floats, b: Floats, lo: Floats, hi: Floats) -> None:
    """Tangents."""
    for k in range(lo.size):
        lo[k], hi[k] = tan_pair(a[k], b[k]) if a[k] <= b[k] else (math.inf, -math.inf)
