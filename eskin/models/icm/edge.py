"""Second pass: the range of the response along one edge where it may have an extremum inside.

Branch and bound on pieces of ``ln τ``. A piece is done as soon as its slope keeps its sign, or it
cannot leave what is already known to be reached, or it bends to one side only and its extremum is
bracketed so closely that what is left (``slope²/(2·least bend)``) does not matter.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels.jit import part
from eskin.models.icm.clock import REACH
from eskin.models.icm.curvature import bend_bounds, limits_of, log_ratio
from eskin.models.icm.response import ROUNDING, UNDERFLOW, branch, respond

if TYPE_CHECKING:
    from typing import TypeAlias

    from eskin.models.icm.clock import Sample
    from eskin.models.icm.response import Phase
    from eskin.models.parameters import Floats

    Span: TypeAlias = tuple[float, float, float, float]
    """Frequency, least and greatest time constant, and scale of an edge."""

PIECES: Final = 96
"""Rows of the stack of pieces that are not done."""
_COLUMNS: Final = 6
STACK: Final = (PIECES, _COLUMNS)
"""Shape of the stack."""
_STEPS: Final = 4000
FINE: Final = 1e-6
"""Of a range: what an open piece may add to it."""


@part
def edge_range(
    span: Span,
    power: int,
    phase: Phase,
    now: Sample,
    known: tuple[float, float, float],
    stack: Floats,
) -> tuple[float, float, float]:
    """Range of ``scale·(τ/τ_a)^p·h`` between two time constants at one sample, and of ``known``.

    Args:
        span: The edge.
        power: p, 0 or 1.
        phase: Of `phase_parts`.
        now: The sample.
        known: A range that is reached anyway, and the sum of sizes behind it.
        stack: Room of shape `STACK`.

    Returns:
        Lower and upper bound, without the rounding of ``h`` itself, and the greatest sum of sizes.
    """
    _, tau_a, tau_b, _ = span
    first, slope, size_a = _point(span, power, tau_a, phase, now)
    last, slope_last, size_b = _point(span, power, tau_b, phase, now)
    lo, hi = min(known[0], min(first, last)), max(known[1], max(first, last))
    state = lo, hi, max(known[2], max(size_a, size_b))
    _push(stack, 0, tau_a, first, slope, tau_b, last, slope_last)
    n, steps = 1, 0
    while n > 0:
        steps += 1
        n, state = _work_on_piece(span, power, phase, now, stack, n - 1, state, steps)
    return state


@part
def _work_on_piece(
    span: Span, power: int, phase: Phase, now: Sample, stack: Floats, n: int,
    state: tuple[float, float, float], steps: int,
) -> tuple[int, tuple[float, float, float]]:  # fmt: skip
    """Close the piece at ``n``, or cut it in two; returns how many are open, and the new state."""
    lo, hi, size = state
    a, f_a, d_a = stack[n, 0], stack[n, 1], stack[n, 2]
    b, f_b, d_b = stack[n, 3], stack[n, 4], stack[n, 5]
    width = log_ratio(a, b)
    second, third = _bends(span, power, a, b, phase, now)
    noise = 3.0 * ROUNDING * size + UNDERFLOW
    fine = FINE * (hi - lo) + 0.25 * ROUNDING * size + UNDERFLOW
    over = 0.125 * second * width * width
    top, bottom = max(f_a, f_b), min(f_a, f_b)
    bend = (d_b - d_a) / width
    least_bend = abs(bend) - 0.5 * third * width - 2.0 * noise / width
    same = ((d_a >= 0.0) & (d_b >= 0.0)) | ((d_a <= 0.0) & (d_b <= 0.0))
    within = (top + over <= hi) & (bottom - over >= lo)
    if within | (same & ((abs(d_a + d_b) >= second * width) | (least_bend > 0.0))):
        return n, state
    if (over <= fine) | (steps >= _STEPS) | (n + 2 >= PIECES) | (b <= a * (1.0 + 1e-14)):
        return n, (min(lo, bottom - over), max(hi, top + over), size)
    mid = math.sqrt(a) * math.sqrt(b)
    if least_bend > 0.0:
        mid = a * math.exp(width * parabola_root(d_a, d_b, (f_b - f_a) / width))
    mid = min(max(mid, a), b)
    f_m, d_m, size_m = _point(span, power, mid, phase, now)
    lo, hi, size = min(lo, f_m), max(hi, f_m), max(size, size_m)
    if least_bend > 0.0:
        beyond = (abs(d_m) + noise) * (abs(d_m) + noise) / (2.0 * least_bend)
        if beyond <= fine:
            lo = min(lo, f_m - beyond) if bend > 0.0 else lo
            hi = max(hi, f_m + beyond) if bend < 0.0 else hi
            return n, (lo, hi, size)
    _push(stack, n, a, f_a, d_a, mid, f_m, d_m)
    _push(stack, n + 1, mid, f_m, d_m, b, f_b, d_b)
    return n + 2, (lo, hi, size)


@part
def _push(
    stack: Floats, k: int, a: float, f_a: float, d_a: float, b: float, f_b: float, d_b: float
) -> None:
    stack[k, 0], stack[k, 1], stack[k, 2] = a, f_a, d_a
    stack[k, 3], stack[k, 4], stack[k, 5] = b, f_b, d_b


@part
def _point(
    span: Span, power: int, tau: float, phase: Phase, now: Sample
) -> tuple[float, float, float]:
    """``scale·(τ/τ_a)^p·h``, its slope in ln τ, and the sum of its sizes."""
    frequency, tau_a, _, scale = span
    h, slope, size, _, _ = respond(branch(frequency, tau), phase, now)
    if power == 0:
        return scale * h, scale * slope, scale * size
    weight = scale * (tau / tau_a)
    return weight * h, weight * (h + slope), weight * size


@part
def _bends(
    span: Span, power: int, a: float, b: float, phase: Phase, now: Sample
) -> tuple[float, float]:
    frequency, tau_a, _, scale = span
    second, third = bend_bounds(
        limits_of(branch(frequency, a), branch(frequency, b), power, phase),
        power,
        a / tau_a if power == 1 else 1.0,
        b / tau_a,
        now[0] / a,
        now[0] / b,
        math.exp(-now[0] / b),
        min(1.0, phase[2] + phase[3] * now[REACH]),
    )
    return second * scale, third * scale


@part
def parabola_root(first: float, last: float, mean: float) -> float:
    """Where in [0, 1] the slope vanishes that starts, ends and averages so (a parabola)."""
    square = 3.0 * (first + last) - 6.0 * mean
    linear = 6.0 * mean - 4.0 * first - 2.0 * last
    root = math.sqrt(max(linear * linear - 4.0 * square * first, 0.0))
    q = -0.5 * (linear + (root if linear >= 0.0 else -root))
    one, other = q / square, first / q
    chord = first / (first - last)
    found = one if (one >= 0.0) & (one <= 1.0) else other
    found = found if (found >= 0.0) & (found <= 1.0) else chord
    return min(max(found, 0.01), 0.99) if found == found else 0.5  # noqa: PLR0124 - NaN test
