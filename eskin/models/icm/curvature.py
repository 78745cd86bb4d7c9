"""How fast the slope of the response can change between two time constants.

With ``y = ln τ`` and ``F = (τ/τ_ref)^p·h`` (p = 0, or 1 where L is held and R moves), bounds of
``|F''|`` and ``|F'''|`` that hold between two time constants come from two sides:

* The phasor ``H = 1/(1 + jx)`` of the settled part: ``G = x^p H`` has ``|G'| <= c1``,
  ``|G''| <= c1`` and ``|G'''| <= 2 c1``. The transient is ``-m·e**-s``, ``m = x^p Im(e^jψ H)``:
  ``sin ψ·c0 - cos ψ·c1``, or ``sin ψ·c1 - cos ψ·q``. For c1, ``|c1'|`` and ``|c1''|`` are at most
  c1 and ``|c1'''|`` 2 c1; for c0 and q it is ``4 c1²``, ``4 c1²`` and ``8 c1²``. Each derivative
  of ``e**-s`` is a polynomial in ``s`` times ``e**-s``, falling beyond a known ``s``, bounded
  before it.
* The integral ``h = ∫ e**-z sin θ(t - τz) dz`` over ``0 <= z <= s``: every derivative in ``y`` puts
  a polynomial in ``z`` into it, so ``S = sup |sin θ|`` times the integral of its size bounds it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels.jit import inlined, part

if TYPE_CHECKING:
    from typing import TypeAlias

    from eskin.models.icm.response import Branch, Phase

    Limits: TypeAlias = tuple[float, float, float]
    Edge: TypeAlias = tuple[float, float, float, float, float, float, Limits]
    Wane: TypeAlias = tuple[float, float, float]

SLACK: Final = 1.0 + 1e-9
"""Pays for the roundings in these bounds, which are never more than a few dozen."""


@part
def log_ratio(tau_a: float, tau_b: float) -> float:
    """Upper bound of ``ln(tau_b/tau_a)`` for ``0 <= tau_a <= tau_b``; 0 where both are the same.

    A frequency may be 0 at both ends: their quotient is then no number.
    """
    gap = (tau_b - tau_a) / tau_a if tau_a < tau_b else 0.0
    return (gap if gap < 1e-3 else math.log(tau_b / tau_a)) * SLACK


@part
def limits_of(a: Branch, b: Branch, power: int, phase: Phase) -> Limits:
    """Bounds between two branches, in units of ``x_a^p``.

    Returns:
        Of the settled slope, of ``m'`` and ``m''``, and of ``m``.
    """
    x_a, x_b = a[5], b[5]
    c1 = 0.5 if (x_a < 1.0) & (x_b > 1.0) else max(a[3], b[3])
    sine, cosine = phase[2], phase[3]
    if power == 0:
        return c1, sine * (4.0 * c1 * c1) + cosine * c1, sine * a[2] + cosine * c1
    ratio = a[0] / b[0]
    settled = 0.5 / x_a
    if x_a >= 1.0:
        settled = a[2]
    elif x_b <= 1.0:
        settled = b[2] * ratio
    return settled, (sine + cosine * (4.0 * c1)) * settled, sine * settled + cosine * (ratio * b[3])


@inlined
def waning(s_last: float, left: float) -> Wane:
    """Bounds of what multiplies ``m'`` and ``m`` in the transient's third derivative, from s on.

    The third value bounds ``s^k e**-s`` for k up to 3, and the polynomials of `_level`.

    Args:
        s_last: Least ``t/τ``, that at the last end.
        left: ``e**-s_last``.
    """
    rise = (2.0 + 3.0 * s_last * s_last) * left if s_last >= 1.5774 else 2.6313
    swing = s_last * (s_last * (s_last - 3.0) + 1.0) * left if s_last >= 4.4909 else 0.42962
    faded = s_last * s_last * s_last * left if s_last >= 4.55 else 1.3443
    return rise, swing, faded


@part
def _level(a: Branch, b: Branch) -> tuple[float, float]:
    """Bounds of ``|D''|``, ``D = h + τ ∂h/∂τ``: settled, and of the transient, by `waning`.

    The settled part of D is the phasor ``H²``, its transient ``-(n + m s) e**-s`` with
    ``n = Im(e^jψ H²)`` and m as for ``p = 0``. With ``|H| = √c0`` and ``|H'| = c1``, and
    ``s' = -s``, the derivatives of ``e**-s`` and ``s·e**-s`` are polynomials of degree 3 at most.
    """
    h = math.sqrt(a[2])
    c1 = 0.5 if (a[5] < 1.0) & (b[5] > 1.0) else max(a[3], b[3])
    settled = 2.0 * c1 * (c1 + h)
    return settled, settled + 4.0 * h * c1 + h * h + 3.0 * c1 + h


@part
def edge_of(a: Branch, b: Branch, tau_a: float, tau_b: float, power: int, phase: Phase) -> Edge:
    """What the tests of an edge need.

    Returns:
        Width ``w`` in ``ln τ``; and ``w²/2`` times the bounds of the third derivative: of its
        settled part, those that go with `waning`, and that by the integral; for ``p = 1`` the
        inverse ratio of the ends, and ``w²/2`` times both of `_level`, and by the integral.
    """
    width = log_ratio(tau_a, tau_b)
    half = 0.5 * width * width * SLACK
    settled, change, size = limits_of(a, b, power, phase)
    third = 2.0 * settled * half, change * half, size * half
    if power == 0:
        return width, *third, half, 1.0, (0.0, 0.0, 0.0)
    level, faded = _level(a, b)
    return width, *third, tau_b / tau_a * half, tau_a / tau_b, (level * half, faded * half, half)


@inlined
def test_edge(
    edge: Edge, power: int, first: float, last: float, s: float, wane: Wane,
    reach: float,
) -> tuple[bool, float, float]:  # fmt: skip
    """What the slopes at both ends prove about what lies between them.

    With ``u`` from 0 to 1 along the edge the slope is within ``k·u(1 - u)`` of the straight line
    between its ends, k being ``w²/2`` times the bound of the third derivative. So it keeps the sign
    of both where their sum and twice the root of their product reach k; the lesser of them stands
    in for the root. For ``p = 1`` the slope over τ, ``h + τ ∂h/∂τ``, has a chance, too: where x or
    s is small, ``F`` itself is nearly straight in τ, or in its square.

    Args:
        edge: Of `edge_of`.
        power: p.
        first: Slope of ``(τ/τ_a)^p·h`` at the first end.
        last: The same at the last end.
        s: ``t/τ`` at the first end, the greatest.
        wane: Of `waning` at the last end.
        reach: Bound of ``|sin θ|`` since time 0.

    Returns:
        Whether the slope keeps its sign; by how much at most ``(τ/τ_a)^p·h`` leaves the range of
        its ends; and k.
    """
    width, settled, change, size, whole, shrink, level = edge
    early = min(s, 1.78303) if power == 0 else min(0.5 * s * s, 2.18327)
    k = min(settled + change * wane[0] + size * wane[1], whole * (reach * early))
    same = (first >= 0.0) == (last >= 0.0)
    less = min(abs(first), abs(last))
    sure = abs(first) + abs(last) + 2.0 * less >= k
    if power == 1:
        to = shrink * abs(last)
        least = min(level[0] + level[1] * wane[2], level[2] * (reach * min(2.0 * s * s, 1.908)))
        sure = sure | (abs(first) + to + 2.0 * min(abs(first), to) >= least)
    sure = sure & same
    return sure, width * ((0.0 if same else 0.5 * less) + 0.17 * k), k


@part
def bend_bounds(
    limits: Limits, power: int, weight: float, weight_last: float, s: float, s_last: float,
    left: float, reach: float,
) -> tuple[float, float]:  # fmt: skip
    """Bounds of ``|F''|`` and ``|F'''|`` between two branches.

    Args:
        limits: Of `limits_of`.
        power: p.
        weight: ``(x_a/x_ref)^p``.
        weight_last: ``(x_b/x_ref)^p``.
        s: ``t/τ`` at the first end, the greatest.
        s_last: At the last end.
        left: ``e**-s_last``.
        reach: Bound of ``|sin θ|`` since time 0.
    """
    rise = (1.0 + 2.0 * s_last) * left if s_last >= 0.5 else 1.2131
    swing = s_last * (s_last - 1.0) * left if s_last >= 2.6181 else 0.30901
    rise3, swing3, _ = waning(s_last, left)
    second = weight * (limits[0] + limits[1] * rise + limits[2] * swing)
    third = weight * (2.0 * limits[0] + limits[1] * rise3 + limits[2] * swing3)
    if power == 0:
        second_too, third_too = reach * min(s, 0.94026), reach * min(s, 1.78303)
    else:
        early = 0.5 * s * s
        second_too = reach * weight_last * min(early, 1.20728)
        third_too = reach * weight_last * min(early, 2.18327)
    return min(second, second_too) * SLACK, min(third, third_too) * SLACK
