"""Enclosures where frequency or phase are intervals, too: branch and bound over whole boxes.

In ``y = ln τ``, ``λ = ln ω`` and ψ the response has a gradient that costs little, and bounds of its
second derivatives by the two ways of `eskin.models.icm.curvature`. Where a partial derivative keeps
its sign over a box, the box shrinks to its end on that side; a box whose bound lies below what is
reached goes; the rest is halved until what is left open does not matter.

Where frequency and phase can make up for each other, the response hardly changes along a ridge, and
second derivatives alone would ask for boxes all along it. There the amplitude over all phases,
``|H|·|1 - e**(-s - ja)|``, bounds a box; and the search starts from the best phase at each corner.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.jit import part
from eskin.models.icm.clock import PI, sample_at
from eskin.models.icm.curvature import SLACK, log_ratio
from eskin.models.icm.decay import decay
from eskin.models.icm.response import (
    ROUNDING,
    UNDERFLOW,
    UNDERFLOW_SIZE,
    branch,
    phase_parts,
    respond,
)

if TYPE_CHECKING:
    from typing import TypeAlias

    from eskin.models.parameters import Floats

    Box: TypeAlias = tuple[float, float, float, float, float, float]

_BOXES: Final = 256
ROOM: Final = (_BOXES, 6)
"""Shape of the stack of boxes that are not done."""
_STEPS: Final = 4000
_FINE: Final = 1e-4  # of the range: what an open box may add to it on one side
_TURNS: Final = 60.0  # rad of uncertainty in ωt, from which on every phase is met
_PIECES: Final = 32


@part
def point(
    f: float, tau: float, psi: float, t: float, power: int, tau_ref: float
) -> tuple[float, float, float, float, float, float]:
    """``(τ/τ_ref)^p·h``, its slopes in y, λ and ψ, the sum of sizes, and the slopes' error."""
    of, phase, now = branch(f, tau), phase_parts(psi), sample_at(f, t)
    h, d, size, _, _ = respond(of, phase, now)
    turned = phase[1], -phase[0], phase[3], phase[2]
    by_phase, _, size_too, _, _ = respond(of, turned, now)
    _, _, c0, c1, q, _ = of
    _, sine, short_sine, v, _, early = now
    _, gone, lag = decay(t / tau)
    a = 2.0 * PI * f * t
    e, k = 2.0 * q * c0, c1 * (1.0 - 2.0 * q)
    rest = -lag if early else gone
    cosine = -v if early else 1.0 - v
    by_pitch = phase[0] * (k * sine + c1 * a * (1.0 - v) - e * (gone - v) - c0 * a * sine)
    by_pitch += phase[1] * (c0 * a * cosine - e * short_sine + k * (v - rest) + c1 * a * sine)
    w = tau / tau_ref if power == 1 else 1.0
    size = max(size, size_too)
    turn = phase[2] * (c1 + c0 * abs(sine)) + phase[3] * (c0 * abs(cosine) + c1 * abs(sine))
    noise = w * (8.0 * ROUNDING * (size * (1.0 + a) + turn * a) + 4.0 * UNDERFLOW)
    slope = h + d if power == 1 else d
    return w * h, w * slope, w * by_pitch, w * by_phase, w * (size + UNDERFLOW_SIZE), noise


@part
def _bends(
    f_a: float, f_b: float, tau_a: float, tau_b: float, t: float, power: int, tau_ref: float,
    reach: float,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """Bounds of the second derivatives: yy, λλ, ψψ, yλ, yψ, λψ.

    ``reach`` bounds ``|sin θ|`` since time 0: under the integral it stays a factor, but where one
    of the two derivatives turned the sine into a cosine.
    """
    x_a, x_b = 2.0 * PI * f_a * tau_a, 2.0 * PI * f_b * tau_b
    a, s_a, s_b = 2.0 * PI * f_b * t, t / tau_a, t / tau_b
    h0 = 1.0 / math.sqrt(1.0 + x_a * x_a)
    c1 = 0.5 if (x_a < 1.0) & (x_b > 1.0) else max(h0 * (x_a * h0), 1.0 / (x_b + 1.0 / x_b))
    left = math.exp(-s_b)
    fall = s_b * left if s_b > 1.0 else 0.36788
    rise = (1.0 + 2.0 * s_b) * left if s_b >= 0.5 else 1.2131
    swing = s_b * (s_b - 1.0) * left if s_b >= 2.6181 else 0.30901
    gone = -math.expm1(-s_a)
    ss = min(h0 * (1.0 + left), gone * reach)
    ps = min(c1 * (1.0 + left) + h0 * a, a * gone * reach)
    pp = min(c1 * (1.0 + left + 2.0 * a) + h0 * (a + a * a), (a + a * a * reach) * gone)
    ys = min(c1 * (1.0 + left) + h0 * fall, s_a, 0.73577)
    yy = min(c1 * (1.0 + rise) + h0 * swing, s_a * reach, 0.94026 * reach)
    yp = min(c1 * (1.0 + left + fall + a), a * min(s_a, 0.73577))
    w = SLACK
    if power == 1:
        w = SLACK * tau_b / tau_ref
        half = 0.5 * s_a * s_a
        # In τ·H = G/ω both |G'| and |G''| are at most c1, and |G| below is: L held, R hardly acts.
        # Where f is 0, τ·H is τ itself.
        of_ref = 1.0 / (2.0 * PI * f_a * tau_b)
        g = of_ref * x_b / math.sqrt(1.0 + x_b * x_b) if f_b > 0.0 else 1.0
        c1 = c1 * of_ref if f_b > 0.0 else 1.0
        yy = min(ss + 2.0 * ys + yy, half * reach, 1.20728 * reach, c1 * (1.0 + rise) + g * swing)
        ys, yp = (
            min(ss + ys, half, 1.0, c1 * (1.0 + left) + g * fall),
            min(ps + yp, a * half, a, c1 * (2.0 + 2.0 * left + a) + (c1 + g) * fall),
        )
    return w * yy, w * pp, w * ss, w * yp, w * ys, w * ps


@part
def _any_turn(sign: float, box: Box, t: float, power: int) -> float:
    """Bound of ``sign·(τ/τ_a)^p·h`` where ωt may end anywhere: ``|H|`` beside the transient.

    The transient ``-m·e**-s``, ``m = sin ψ·c0 - cos ψ·c1``, knows its phase; it is bounded piece by
    piece.
    """
    f_a, f_b, tau_a, tau_b, psi_a, psi_b = box
    psi, r_s = 0.5 * psi_a + 0.5 * psi_b, 0.5 * (psi_b - psi_a)
    sine, cosine = math.sin(psi), math.cos(psi)
    step_tau = math.exp(log_ratio(tau_a, tau_b) / _PIECES)
    step_f = math.exp(log_ratio(f_a, f_b) / _PIECES)
    most = 0.0
    tau_lo = tau_a
    for i in range(_PIECES):
        tau_hi = tau_b if i == _PIECES - 1 else min(tau_lo * step_tau, tau_b)
        w = tau_hi / tau_a if power == 1 else 1.0
        low, high = math.exp(-t / tau_lo), math.exp(-t / tau_hi)
        f_lo = f_a
        for j in range(_PIECES):
            f_hi = f_b if j == _PIECES - 1 else min(f_lo * step_f, f_b)
            x, r_x = PI * (f_lo * tau_lo + f_hi * tau_hi), PI * (f_hi * tau_hi - f_lo * tau_lo)
            x_lo = 2.0 * PI * f_lo * tau_lo
            c0 = 1.0 / (1.0 + x * x)
            size = 1.0 / math.sqrt(1.0 + x_lo * x_lo)
            # |dm/dx| = |H|² at most, |dm/dψ| = |H| at most.
            free = -sign * (sine - cosine * x) * c0 + size * min(r_s + size * r_x, 2.0)
            free = min(free, size)
            bound = size + (free * high if free > 0.0 else free * low)
            most = max(most, w * bound + 1e-14 * w * size)
            f_lo = f_hi
        tau_lo = tau_hi
    return most * SLACK


@part
def _amplitude(
    box: Box, middle: tuple[float, float], t: float, power: int, tau_ref: float
) -> float:
    """Bound of ``|(τ/τ_ref)^p·h|`` over a box for any phase, from ``(f, τ)`` in its middle."""
    f_lo, f_hi, tau_lo, tau_hi, _, _ = box
    f, tau = middle
    r_y = max(log_ratio(tau_lo, tau), log_ratio(tau, tau_hi))
    r_p = max(log_ratio(f_lo, f), log_ratio(f, f_hi))
    x = 2.0 * PI * f_lo * (tau_hi if power == 1 else tau_lo)
    size = (tau_hi / tau_ref if power == 1 else 1.0) / math.sqrt(1.0 + x * x)
    s, left, most_left = t / tau_hi, math.exp(-t / tau), math.exp(-t / tau_hi)
    a, most_a = 2.0 * PI * f * t, 2.0 * PI * f_hi * t
    fall = s * most_left if s > 1.0 else 0.36788
    swing = math.hypot(1.0 - left * math.cos(a), left * math.sin(a))
    change = fall * r_y + most_a * most_left * r_p
    return size * (swing + change + 2e-15 * (1.0 + most_a)) * SLACK


@part
def _at_best_phase(
    sign: float, f: float, tau: float, phases: tuple[float, float], t: float, power: int,
    tau_ref: float,
) -> float:  # fmt: skip
    """The response where the phase makes it greatest, or at the first phase."""
    of_sine, _, _, _, _, _ = point(f, tau, 0.5 * PI, t, power, tau_ref)
    of_cosine, _, _, _, _, _ = point(f, tau, 0.0, t, power, tau_ref)
    peak = math.atan2(sign * of_sine, sign * of_cosine)
    psi = peak + 2.0 * PI * np.ceil((phases[0] - peak) / (2.0 * PI))
    psi = psi if (psi >= phases[0]) & (psi <= phases[1]) else phases[0]
    value, _, _, _, _, _ = point(f, tau, psi, t, power, tau_ref)
    return sign * value


@part
def supremum(
    sign: float, box: Box, t: float, power: int, span: tuple[float, float], stack: Floats
) -> tuple[float, float, float]:
    """Upper bound of ``sign·(τ/τ_a)^p·h`` over a box.

    Args:
        sign: 1, or -1 for the infimum of the response itself.
        box: Bounds of frequency, time constant and phase.
        t: Time.
        power: p.
        span: A part of the range: what is fine is measured by it.
        stack: Room for boxes.

    Returns:
        The bound, the greatest value that is reached, and the greatest sum of sizes.
    """
    f_a, f_b, tau_a, tau_b, psi_a, psi_b = box
    first, _, _, _, size, _ = point(f_a, tau_a, psi_a, t, power, tau_a)
    last, _, _, _, size_too, _ = point(f_b, tau_b, psi_b, t, power, tau_a)
    best, size = max(sign * first, sign * last), max(size, size_too)
    if 2.0 * PI * t * (f_b - f_a) > _TURNS:
        return max(best, _any_turn(sign, box, t, power)), best, size
    if psi_b > psi_a:
        for f in (f_a, f_b):
            for tau in (tau_a, tau_b):
                value = _at_best_phase(sign, f, tau, (psi_a, psi_b), t, power, tau_a)
                best = max(best, value)
    _push(stack, 0, box)
    n, steps = 1, 0
    state = best, best, size
    while n > 0:
        steps += 1
        n, state = _work_on_box(sign, tau_a, t, power, span, stack, (n - 1, steps), state)
    return max(state[0], state[1]), state[1], state[2]


@part
def _work_on_box(
    sign: float, tau_ref: float, t: float, power: int, span: tuple[float, float], stack: Floats,
    at: tuple[int, int], state: tuple[float, float, float],
) -> tuple[int, tuple[float, float, float]]:  # fmt: skip
    """Close a box, shrink it or halve it; returns how many are open, and the new state.

    ``at`` states where the box is and how many were before it; ``state`` is the bound, the greatest
    value and the sum of sizes so far; ``tau_ref`` the unit of τ. The rest is as in `supremum`.
    """
    bound, best, size = state
    n, steps = at
    f_lo, f_hi, tau_lo, tau_hi = stack[n, 0], stack[n, 1], stack[n, 2], stack[n, 3]
    psi_lo, psi_hi = stack[n, 4], stack[n, 5]
    f = min(max(math.sqrt(f_lo) * math.sqrt(f_hi), f_lo), f_hi)
    tau = min(max(math.sqrt(tau_lo) * math.sqrt(tau_hi), tau_lo), tau_hi)
    psi = min(max(0.5 * (psi_lo + psi_hi), psi_lo), psi_hi)
    r_y = max(log_ratio(tau_lo, tau), log_ratio(tau, tau_hi))
    r_p = max(log_ratio(f_lo, f), log_ratio(f, f_hi))
    r_s = max(psi - psi_lo, psi_hi - psi) * SLACK
    value, g_y, g_p, g_s, size_here, noise = point(f, tau, psi, t, power, tau_ref)
    value, g_y, g_p, g_s = sign * value, sign * g_y, sign * g_p, sign * g_s
    size, best = max(size, size_here), max(best, value)
    reach = min(1.0, abs(math.sin(psi)) + r_s + 2.0 * PI * f_hi * t + 1e-15)
    yy, pp, ss, yp, ys, ps = _bends(f_lo, f_hi, tau_lo, tau_hi, t, power, tau_ref, reach)
    change_y = yy * r_y + yp * r_p + ys * r_s
    change_p = yp * r_y + pp * r_p + ps * r_s
    change_s = ys * r_y + ps * r_p + ss * r_s
    rise = (abs(g_y) + noise) * r_y + (abs(g_p) + noise) * r_p + (abs(g_s) + noise) * r_s
    over = rise + 0.5 * (change_y * r_y + change_p * r_p + change_s * r_s)
    fine = _FINE * max(best - span[0], span[1] - span[0]) + 0.25 * ROUNDING * size + UNDERFLOW
    box = f_lo, f_hi, tau_lo, tau_hi, psi_lo, psi_hi
    most = min(value + over, _amplitude(box, (f, tau), t, power, tau_ref))
    if most <= max(bound, best + fine) or n + 2 >= _BOXES or steps >= _STEPS:
        return n, (max(bound, most), best, size)
    tau_lo, tau_hi, one = _shrunk(tau_lo, tau_hi, r_y, g_y, change_y + noise)
    f_lo, f_hi, two = _shrunk(f_lo, f_hi, r_p, g_p, change_p + noise)
    psi_lo, psi_hi, three = _shrunk(psi_lo, psi_hi, r_s, g_s, change_s + noise)
    box = f_lo, f_hi, tau_lo, tau_hi, psi_lo, psi_hi
    if one | two | three:
        _push(stack, n, box)
        return n + 1, (bound, best, size)
    shares = (abs(g_p) + change_p) * r_p, (abs(g_y) + change_y) * r_y, (abs(g_s) + change_s) * r_s
    _halve(stack, n, box, (f, tau, psi), shares)
    return n + 2, (bound, best, size)


@part
def _shrunk(
    lo: float, hi: float, radius: float, slope: float, change: float
) -> tuple[float, float, bool]:
    """The upper end alone where the slope is certain to rise, the lower where it falls."""
    sure = (radius > 0.0) & (abs(slope) > change)
    return (hi if sure & (slope > 0.0) else lo), (lo if sure & (slope < 0.0) else hi), sure


@part
def _halve(
    stack: Floats, n: int, box: Box, middle: tuple[float, float, float],
    shares: tuple[float, float, float],
) -> None:  # fmt: skip
    """Put the two halves on the stack, cut where most of the change comes from."""
    _push(stack, n, box)
    _push(stack, n + 1, box)
    k = 0 if shares[0] >= max(shares[1], shares[2]) else (1 if shares[1] >= shares[2] else 2)
    stack[n, 2 * k + 1] = middle[k]
    stack[n + 1, 2 * k] = middle[k]


@part
def _push(stack: Floats, n: int, box: Box) -> None:
    stack[n, 0], stack[n, 1], stack[n, 2] = box[0], box[1], box[2]
    stack[n, 3], stack[n, 4], stack[n, 5] = box[3], box[4], box[5]
