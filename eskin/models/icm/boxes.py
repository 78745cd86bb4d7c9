"""Bounds of current and voltage for rows whose frequency or phase are intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.kernels.outward_rounding import div_down, div_up, mul_down, mul_up
from eskin.models.icm.box import ROOM, point, supremum
from eskin.models.icm.clock import PI
from eskin.models.icm.curvature import SLACK
from eskin.models.icm.scaling import error_factor, scale_outward

if TYPE_CHECKING:
    from eskin.models.icm.bracket import Indices
    from eskin.models.parameters import Floats

_NEAR_ZERO: Final = 1e-10  # of a turn: a frequency below this is as good as this


@part
def _box_range(
    given: Floats, tau_a: float, tau_b: float, power: int, scale: float, time: float,
    known: tuple[float, float, float], stack: Floats,
) -> tuple[float, float, float]:  # fmt: skip
    """Range of ``scale·(τ/τ_a)^p·h`` over one box, joined to ``known``, and its sum of sizes."""
    t = max(time, 0.0)
    f_a, f_b = given[2], given[3]
    slack = 0.0
    if f_a == 0.0 and f_b > 0.0:
        # |∂h/∂ω| <= t: what lies below costs next to nothing.
        f_a = min(f_b, _NEAR_ZERO / max(t, 1e-60))
        slack = 2.0 * PI * f_a * t * SLACK * (tau_b / tau_a if power == 1 else 1.0)
    span = known[0] / scale, known[1] / scale
    box = f_a, f_b, tau_a, tau_b, given[4], given[5]
    top, reached, size = supremum(1.0, box, t, power, span, stack)
    down = -max(reached, span[1]), -span[0]
    bottom, _, size_too = supremum(-1.0, box, t, power, down, stack)
    lo, hi = scale * (-bottom - slack), scale * (top + slack)
    return min(known[0], lo), max(known[1], hi), max(known[2], scale * max(size, size_too))


@kernel
def voltage_boxes(
    rows: Floats, clock_of: Indices, times: Floats, lo: Floats, hi: Floats
) -> None:  # fmt: skip
    """Bounds of u_c for rows of interval frequency or phase; see `voltage_rows`."""
    stack, size = np.empty(ROOM), np.empty(times.shape[1])
    for row in range(rows.shape[0]):
        given = rows[row]
        tau_a, tau_b = mul_down(given[6], given[8]), mul_up(given[7], given[9])
        for i in range(times.shape[1]):
            t = times[clock_of[row], i]
            start, _, _, _, _, _ = point(given[2], tau_a, given[4], max(t, 0.0), 0, tau_a)
            known = _box_range(given, tau_a, tau_b, 0, 1.0, t, (start, start, 0.0), stack)
            lo[row, i], hi[row, i], size[i] = known
        found = lo[row], hi[row], size
        scale_outward(given[0], given[1], error_factor(0.0), times[clock_of[row]], found)


@kernel
def current_boxes(
    rows: Floats, clock_of: Indices, times: Floats, lo: Floats, hi: Floats
) -> None:  # fmt: skip
    """Bounds of i1 for rows of interval frequency or phase; see `current_rows`."""
    stack, size = np.empty(ROOM), np.empty(times.shape[1])
    for row in range(rows.shape[0]):
        given = rows[row]
        r_a, r_b, l_a, l_b = given[6], given[7], given[8], given[9]
        for i in range(times.shape[1]):
            t = times[clock_of[row], i]
            start, _, _, _, _, _ = point(given[2], l_a / r_b, given[4], max(t, 0.0), 0, 1.0)
            known = start, start, 0.0
            known = _box_range(given, l_a / r_b, l_b / r_b, 0, 1.0, t, known, stack)
            known = _box_range(given, l_a / r_a, l_b / r_a, 0, r_b / r_a, t, known, stack)
            known = _box_range(given, l_a / r_b, l_a / r_a, 1, 1.0, t, known, stack)
            known = _box_range(given, l_b / r_b, l_b / r_a, 1, 1.0, t, known, stack)
            lo[row, i], hi[row, i], size[i] = known
        inf, sup = div_down(given[0], r_b), div_up(given[1], r_b)
        found = lo[row], hi[row], size
        scale_outward(inf, sup, error_factor(0.0), times[clock_of[row]], found)
