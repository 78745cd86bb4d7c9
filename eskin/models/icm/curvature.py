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

A slope may nearly be a power of x all along (far from x = 1, or early). Then that power, taken out
of it, leaves what hardly changes, and the test of the sign hardly ever fails: ``x^k`` times the
settled slope changes by ``2 c1 √q`` for ``k = -1``, by ``2 c1 √c0`` for ``k = 1``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from eskin.kernels.compiled import part

if TYPE_CHECKING:
    from typing import TypeAlias

    from eskin.models.icm.response import Branch, Phase

    Limits: TypeAlias = tuple[float, float, float]
    Edge: TypeAlias = tuple[float, float, Limits, bool, float, Limits]

SLACK: Final = 1.0 + 1e-9
"""Pays for the roundings in these bounds, which are never more than a few dozen."""
_WIDEST: Final = 1e3


@part
def log_ratio(tau_a: float, tau_b: float) -> float:
    """Upper bound of ``ln(tau_b/tau_a)`` for ``tau_a <= tau_b``."""
    gap = (tau_b - tau_a) / tau_a
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


@part
def _flat(a: Branch, b: Branch, ratio: float, power: int) -> tuple[float, float, float]:
    """For the test of the slope times ``x^k``, in units of ``x_a^(k+p)``.

    Returns:
        The weight of the last slope, the bound of the change of the settled slope, and by how much
        the bounds of the transient grow. Infinite where neither ``k = -1`` nor 1 gains.
    """
    if b[5] < 0.57:
        settled = 2.0 * b[3] * math.sqrt(b[2])
        return (1.0 / ratio, settled * a[5], 1.0) if power == 0 else (1.0, settled, 1.0)
    if a[5] > 1.74:
        settled = 2.0 * a[4] * math.sqrt(a[2]) / a[5]
        if power == 0:
            return ratio, settled, ratio
        return ratio * ratio, settled / a[5], ratio
    return 1.0, math.inf, 1.0


@part
def edge_of(a: Branch, b: Branch, tau_a: float, tau_b: float, power: int, phase: Phase) -> Edge:
    """What the tests of an edge need.

    Returns:
        Width in ``ln τ``, ratio of the ends, bounds of the change of the slope; whether the edge is
        too wide for tests; and for the flattened slope the weight of its end and its bounds.
    """
    width = log_ratio(tau_a, tau_b)
    ratio = tau_b / tau_a
    cost = width * SLACK
    settled, change, size = limits_of(a, b, power, phase)
    weight, flat, growth = _flat(a, b, ratio, power)
    limits = settled * cost, change * cost, size * cost
    flat_limits = flat * cost, limits[1] * growth, limits[2] * growth
    return width, ratio, limits, ratio > _WIDEST, weight, flat_limits


@part
def test_edge(
    edge: Edge, power: int, first: float, last: float, s: float, s_last: float, left: float,
    reach: float,
) -> tuple[bool, float]:  # fmt: skip
    """What the slopes at both ends prove about what lies between them.

    Args:
        edge: Of `edge_of`.
        power: p.
        first: ``p·h + d`` at the first end.
        last: The same at the last end.
        s: ``t/τ`` at the first end, the greatest.
        s_last: At the last end.
        left: ``e**-s_last``.
        reach: Bound of ``|sin θ|`` since time 0.

    Returns:
        Whether the slope keeps its sign; and by how much at most ``(τ/τ_a)^p·h`` leaves the
        range of its ends.
    """
    width, ratio, limits, wide, weight, flat = edge
    rise = (1.0 + 2.0 * s_last) * left if s_last >= 0.5 else 1.2131
    swing = s_last * (s_last - 1.0) * left if s_last >= 2.6181 else 0.30901
    change = limits[0] + limits[1] * rise + limits[2] * swing
    # Both polynomials times e**-s fall from s = 0 on.
    flat_change = (2.0 + 2.0 * s_last) * flat[1] + (2.0 + s_last * (2.0 + s_last)) * flat[2]
    by_power = abs(first + weight * last) >= flat[0] + flat_change * left
    if power == 0:
        by_phasor = abs(first + last) >= change
        most = min(s * s, 1.08269) * (ratio - 1.0) * (reach * SLACK)
        by_integral = abs(first + ratio * last) >= most
        bend = reach * min(s, 0.94026)
    else:
        by_phasor = abs(first + ratio * last) >= change
        square = ratio * ratio
        most = min(s * s * s * 0.16666667, 1.0) * (square - 1.0) * (reach * SLACK)
        by_integral = abs(first + square * last) >= most
        bend = reach * ratio * min(0.5 * s * s, 1.20728)
    same = ((first >= 0.0) & (last >= 0.0)) | ((first <= 0.0) & (last <= 0.0))
    sure = (same & (by_phasor | by_integral | by_power) & (not wide)) | (width == 0.0)
    return sure, 0.125 * width * min(change, bend * width * SLACK)


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
    rise3 = (2.0 + 3.0 * s_last * s_last) * left if s_last >= 1.5774 else 2.6313
    swing3 = s_last * (s_last * (s_last - 3.0) + 1.0) * left if s_last >= 4.4909 else 0.42962
    second = weight * (limits[0] + limits[1] * rise + limits[2] * swing)
    third = weight * (2.0 * limits[0] + limits[1] * rise3 + limits[2] * swing3)
    if power == 0:
        second_too, third_too = reach * min(s, 0.94026), reach * min(s, 1.78303)
    else:
        early = 0.5 * s * s
        second_too = reach * weight_last * min(early, 1.20728)
        third_too = reach * weight_last * min(early, 2.18327)
    return min(second, second_too) * SLACK, min(third, third_too) * SLACK
